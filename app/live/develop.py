"""From what a frame shows to a picture of one kind, and the picture for when there is none."""

from dataclasses import dataclass, replace

import numpy as np

from app.devices.frame import Frame
from app.errors import DeviceError
from app.geometry.arrays import Pixels
from app.live.picture import JPEG, LivePicture
from app.live.search import Found
from app.live.settings import Kind
from app.live.sight import Sight
from app.recording.picture import encode
from app.vision.overlay import Marks, painted, shrunk, with_notice
from app.vision.stripe import Image

_JPEG_START = b"\xff\xd8"
_BLANK = (640, 360)
_LEAST_WIDTH = 640
# A page draws a circle of so many fewer points as well.
_EVERY = 5


@dataclass(frozen=True, slots=True)
class Flavour:
    """A picture that is made once for all who want the same.

    Attributes:
        kind: what it shows.
        width: columns at most; None for those of the settings.
        is_packed: a mask as bits, not as JPEG.
        is_captioned: whether words are written into it, for viewers that cannot say them beside it.
    """

    kind: Kind
    width: int | None = None
    is_packed: bool = False
    is_captioned: bool = True

    @property
    def is_as_it_comes(self) -> bool:
        """Whether it is the camera's own picture."""
        return self.kind is Kind.RAW and self.width is None


def develop(flavour: Flavour, sight: Sight, found: Found, own_jpeg: bytes | None) -> LivePicture:
    """The picture of one flavour.

    Args:
        flavour: which.
        sight: the frame.
        found: board and markers, which need not be of this frame.
        own_jpeg: the file that the camera sent, where it is upright.

    Raises:
        DeviceError: the camera sent something that is no whole picture.
    """
    width = _width(flavour, sight)
    if flavour.kind is Kind.RAW:
        if own_jpeg is not None and own_jpeg.startswith(_JPEG_START) and not _is_less(width, sight.frame):
            return _picture(flavour, sight, own_jpeg)
        return _picture(flavour, sight, _jpeg(shrunk(sight.image, width), sight))
    if flavour.kind is Kind.STRIPE:
        return _numbered(flavour, sight, found).with_stripes(sight.stripes, _marks(sight, found, _EVERY))
    if flavour.kind is Kind.MASK:
        mask = shrunk(255 * sight.mask.astype(np.uint8), width)
        if flavour.is_packed:
            return _numbered(flavour, sight, found).with_bits(mask > 0)
        return _numbered(flavour, sight, found, _jpeg(mask, sight))
    marks = _marks(sight, found)
    if flavour.is_captioned:
        marks = replace(marks, captions=sight.captions)
    return _numbered(flavour, sight, found, _jpeg(painted(sight.image, marks, width), sight))


def nothing_new(flavour: Flavour, last: Frame | None, problem: str) -> LivePicture:
    """Says that no picture comes: the last one dimmed, with the sentence on it; no stripes, nothing lit.

    Args:
        flavour: which.
        last: the newest frame there was.
        problem: why, as a sentence.
    """
    size = _BLANK if last is None else last.size
    index, exposed_s = (-1, 0.0) if last is None else (last.index, last.exposed_s)
    picture = LivePicture(
        flavour.kind, b"", JPEG, index, exposed_s, size, is_stale=True, problem=problem
    )  # fmt: skip
    if flavour.kind is Kind.STRIPE:
        return picture.with_stripes(())
    if flavour.is_packed:
        return picture.with_bits(np.zeros((size[1], size[0]), np.bool_))
    words = ("No picture.", problem) if flavour.is_captioned else ()
    image = with_notice(shrunk(_last_image(last), flavour.width), words)
    return LivePicture(
        flavour.kind, encode(image, "jpeg", 80), JPEG, index, exposed_s, size, None, True, problem
    )


def _marks(sight: Sight, found: Found, every: int = 1) -> Marks:
    """What is marked; of the curves in the outlines only every so-manieth point."""
    stripes = tuple(each.stripe for each in sight.stripes)
    outlines: list[Pixels] = []
    if sight.settings.shows_region:
        outlines += [
            line[::every] if len(line) > every else line for line in sight.known.outlines(sight.frame.size)
        ]
        if sight.settings.polygon:
            corners = np.array(sight.settings.polygon) * sight.frame.size - 0.5
            outlines.append(np.vstack([corners, corners[:1]]))
    board = found.board if found.board is not None and found.board.is_found else None
    return Marks(stripes, board, found.markers, tuple(outlines))


def _width(flavour: Flavour, sight: Sight) -> int | None:
    """What was asked for; else, of what has to be drawn here, half the camera's, unless that is little."""
    wanted = sight.settings.width if flavour.width is None else flavour.width
    if wanted is not None or flavour.is_packed or flavour.kind not in (Kind.OVERLAY, Kind.MASK):
        return wanted
    return max(sight.frame.size[0] // 2, _LEAST_WIDTH)


def _is_less(width: int | None, frame: Frame) -> bool:
    return width is not None and width < frame.size[0]


def _jpeg(image: Image, sight: Sight) -> bytes:
    return encode(image, "jpeg", sight.settings.quality)


def _picture(flavour: Flavour, sight: Sight, data: bytes) -> LivePicture:
    frame = sight.frame
    return LivePicture(flavour.kind, data, JPEG, frame.index, frame.exposed_s, frame.size)


def _numbered(flavour: Flavour, sight: Sight, found: Found, data: bytes = b"") -> LivePicture:
    frame, markers = sight.frame, 0 if found.markers is None else len(found.markers.ids)
    numbers = replace(sight.numbers, corners=found.corners, markers=markers)
    return LivePicture(flavour.kind, data, JPEG, frame.index, frame.exposed_s, frame.size, numbers)


def _last_image(last: Frame | None) -> Image:
    blank = np.zeros((_BLANK[1], _BLANK[0]), np.uint8)
    if last is None:
        return blank
    try:
        return last.image()
    except DeviceError:
        return blank
