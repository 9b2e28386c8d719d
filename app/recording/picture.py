"""Pictures in PNG or JPEG files: checked before they are decoded, because decoders forgive too much.

OpenCV fills the missing half of a truncated JPEG with grey and says nothing, so the end of the picture is
looked for here; and a file of few bytes can claim a size of gigabytes, so the claim is read first.
"""

import struct
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from app.errors import OptionError
from app.vision.stripe import Image

ImageFormat: TypeAlias = Literal["png", "jpeg"]

_PNG_START = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_JPEG_START = b"\xff\xd8"
_JPEG_END = b"\xff\xd9"
# SOF0..SOF15 carry the size; C4, C8 and CC in that range are tables.
_JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_SCAN = 0xDA
_JPEG_BARE = frozenset({0x01, *range(0xD0, 0xD8)})
# Fastest for noisy pictures: entropy coding alone, of differences to the pixel on the left.
_PNG_OPTIONS = [
    cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
]  # fmt: skip
if hasattr(cv2, "IMWRITE_PNG_FILTER"):
    _PNG_OPTIONS += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
# Orientation tags are left alone: the calibration belongs to the sensor, whichever way up the camera felt.
_AS_STORED = cv2.IMREAD_IGNORE_ORIENTATION


@dataclass(frozen=True, slots=True)
class PictureFacts:
    """What a file says of itself.

    Attributes:
        format: of the file.
        size: width and height in pixels as stored, orientation tags ignored.
    """

    format: ImageFormat
    size: tuple[int, int]

    @property
    def suffix(self) -> str:
        return ".png" if self.format == "png" else ".jpg"


def inspect(data: bytes) -> PictureFacts:
    """Read the header and look for the end, without decoding.

    Raises:
        ValueError: with the problem as a predicate, such as `is truncated`.
    """
    if not data:
        raise ValueError("is empty")
    if data.startswith(_PNG_START):
        return _inspect_png(data)
    if data.startswith(_JPEG_START):
        return _inspect_jpeg(data)
    raise ValueError("is neither PNG nor JPEG")


def decode(data: bytes, size: tuple[int, int], *, grey: bool = False) -> Image:
    """The picture, (H, W, 3) BGR or (H, W) grey.

    Args:
        data: a PNG or JPEG file.
        size: the width and height it must have.
        grey: decode the luminance only, which costs a JPEG about half the time.

    Raises:
        ValueError: with the problem as a predicate.
    """
    facts = inspect(data)
    if facts.size != size:
        raise ValueError(f"is {facts.size[0]} x {facts.size[1]} pixels, not {size[0]} x {size[1]}")
    flags = (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR) | _AS_STORED
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError("cannot be decoded") from error
    if image is None or image.shape[1::-1] != size:
        raise ValueError("cannot be decoded")
    return image.astype(np.uint8, copy=False)


def encode(image: Image, image_format: ImageFormat = "png", quality: int = 95) -> bytes:
    """The bytes of a PNG (fast, lossless) or JPEG file.

    Args:
        image: (H, W, 3) BGR or (H, W) grey.
        image_format: png or jpeg.
        quality: of a JPEG, 1..100.
    """
    if image_format == "png":
        suffix, options = ".png", _PNG_OPTIONS
    elif image_format == "jpeg":
        suffix, options = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality]
    else:
        raise OptionError(f"There is no picture format {image_format!r}.", "Choose png or jpeg.")
    is_done, data = cv2.imencode(suffix, image, options)
    if not is_done:
        raise OptionError(f"A picture of shape {image.shape} cannot be encoded.")
    return data.tobytes()


def _inspect_png(data: bytes) -> PictureFacts:
    if len(data) < 24 or data[12:16] != b"IHDR" or data.rfind(_PNG_END, 33) < 0:
        raise ValueError("is truncated")
    width, height = struct.unpack(">II", data[16:24])
    return PictureFacts("png", (width, height))


def _inspect_jpeg(data: bytes) -> PictureFacts:
    """Walk the segments to the size and on to the first scan, behind which the end marker must come.

    An end marker before that may belong to a thumbnail; within the scan 0xFF is always escaped.
    """
    size, at = None, 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            raise ValueError("is damaged")
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        if marker in _JPEG_BARE:
            at += 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _JPEG_FRAME_MARKERS and at + 9 <= len(data):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            size = (width, height)
        at += 2 + length
        if marker == _JPEG_SCAN:
            break
    if size is None or data.rfind(_JPEG_END, at) < 0:
        raise ValueError("is truncated")
    return PictureFacts("jpeg", size)
