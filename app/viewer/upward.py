"""What a page may say to viser."""

import msgspec

# What its own client says while somebody looks, turns the scene and clicks. Nothing that asks viser
# for files, commands or a public address.
WELCOME = frozenset(
    {
        "ViewerCameraMessage",
        "SceneNodeClickMessage",
        "SceneNodeDragMessage",
        "ScenePointerMessage",
        "TransformControlsUpdateMessage",
        "TransformControlsDragStartMessage",
        "TransformControlsDragEndMessage",
    }
)
LARGEST_BYTES = 64 * 1024


class _Head(msgspec.Struct):
    type: str


_decoder = msgspec.msgpack.Decoder(_Head)


def kind_of(message: bytes) -> str:
    """The type that a message names; what is no message of viser's has a description in brackets."""
    if len(message) > LARGEST_BYTES:
        return "(too large)"
    try:
        return _decoder.decode(message).type
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return "(unreadable)"
