"""Decoders forgive too much; these files must not pass."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from app.recording.picture import ImageFormat, decode, encode, inspect

PICTURE = np.random.default_rng(0).integers(0, 255, (30, 40, 3), dtype=np.uint8)
SMOOTH = np.tile(np.linspace(0, 255, 40).astype(np.uint8), (30, 1))
FORMATS: tuple[ImageFormat, ...] = ("png", "jpeg")


def jpeg_with_thumbnail() -> bytes:
    """A JPEG whose first segment holds another one, end marker and all, as cameras write them."""
    inner = encode(SMOOTH, "jpeg")
    outer = encode(PICTURE, "jpeg")
    return outer[:2] + b"\xff\xe1" + struct.pack(">H", len(inner) + 2) + inner + outer[2:]


def test_png_is_lossless_and_jpeg_nearly() -> None:
    assert_array_equal(decode(encode(PICTURE), (40, 30)), PICTURE)
    jpeg = decode(encode(SMOOTH, "jpeg"), (40, 30), grey=True)
    assert np.abs(jpeg.astype(int) - SMOOTH).max() <= 3


@pytest.mark.parametrize("image_format", FORMATS)
def test_grey_is_grey_and_colour_is_colour_whatever_the_file_holds(image_format: ImageFormat) -> None:
    for image in (PICTURE, SMOOTH):
        data = encode(image, image_format)
        assert decode(data, (40, 30), grey=True).shape == (30, 40)
        assert decode(data, (40, 30)).shape == (30, 40, 3)


@pytest.mark.parametrize("data", [encode(PICTURE), encode(PICTURE, "jpeg"), jpeg_with_thumbnail()])
def test_a_file_cut_anywhere_is_truncated(data: bytes) -> None:
    assert inspect(data).size == (40, 30)
    for end in range(9, len(data) - 1, 7):
        with pytest.raises(ValueError, match=r"is truncated|is damaged"):
            inspect(data[:end])


def test_bytes_after_the_picture_are_no_harm() -> None:
    for image_format in FORMATS:
        assert decode(encode(SMOOTH, image_format) + b"\0" * 100, (40, 30), grey=True).shape == (30, 40)


def test_a_wrong_size_is_told_before_decoding() -> None:
    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in ((b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b""))
    )
    with pytest.raises(ValueError, match="is 60000 x 60000 pixels, not 40 x 30"):
        decode(bomb, (40, 30))
    with pytest.raises(ValueError, match="cannot be decoded"):
        decode(bomb, (60000, 60000))


def test_damaged_pixels_of_a_png_are_noticed() -> None:
    data = bytearray(encode(PICTURE))
    data[len(data) // 2] ^= 255
    with pytest.raises(ValueError, match="cannot be decoded"):
        decode(bytes(data), (40, 30))


@given(
    st.binary(max_size=300), st.sampled_from([b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"\xff\xd8\xff\xc0"])
)
def test_no_bytes_are_a_surprise(data: bytes, start: bytes) -> None:
    with pytest.raises(ValueError, match=r"^(is|cannot) "):
        decode(start + data, (40, 30))
