"""What goes over the wire can be read again."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.live.picture import JPEG, MESSAGE, LiveNumbers, LivePicture, NamedStripe, unpack
from app.live.settings import Kind
from app.vision.stripe import LaserStripe, Orientation

_PAGE = Path(__file__).resolve().parents[2] / "docs" / "live.md"
_NUMBERS = LiveNumbers(12, 3, 4.25, (0.5,) * 2 + (0.0,) * 62, 1500.0)


def test_a_jpeg_travels_with_its_frame_and_numbers() -> None:
    picture = LivePicture(Kind.OVERLAY, b"\xff\xd8 picture", JPEG, 7, 1.25, (640, 480), _NUMBERS)
    message = picture.message()
    there = unpack(message)
    assert message[0] == there.code == 2
    assert there.body == picture.data
    assert there.facts["frame"] == 7
    assert there.facts["exposed_s"] == 1.25
    assert there.facts["size"] == [640, 480]
    assert there.facts["numbers"]["saturated"] == 3
    assert len(there.facts["numbers"]["histogram"]) == 64


def test_the_body_begins_where_a_page_can_lay_an_array_of_numbers_over_it() -> None:
    for problem in ("", "a", "ab", "ü"):
        picture = LivePicture(Kind.RAW, b"x", JPEG, 0, 0.0, (1, 1), None, True, problem)
        message = picture.message()
        length = struct.unpack_from("<I", message, 4)[0]
        assert (8 + length) % 8 == 0
        assert json.loads(message[8 : 8 + length])["problem"] == problem


def test_the_message_that_the_documentation_takes_apart_is_one() -> None:
    example = _PAGE.read_text().split("A whole message")[1].split("```\n")[1]
    head, facts, body = example.rstrip("\n").split("\n")
    there = unpack(bytes.fromhex(head) + facts.encode() + bytes.fromhex(body))
    (laser, orientation, pixels, flags), *others = there.stripes()
    assert (laser, orientation, others) == ("left", "vertical", [])
    assert pixels.tolist() == [[320.5, 100.0], [320.75, 101.0]]
    assert flags.tolist() == [2, 1]


@given(
    columns=st.lists(st.floats(0.0, 1279.0), max_size=60),
    orientation=st.sampled_from(["vertical", "horizontal"]),
    width=st.sampled_from([64, 1280, 4608, 9000]),
)
def test_stripe_positions_arrive_to_a_part_of_a_pixel(
    columns: list[float], orientation: Orientation, width: int
) -> None:
    stripe = stripe_of(columns, orientation)
    blank = LivePicture(Kind.STRIPE, b"", JPEG, 1, 0.0, (width, 4), _NUMBERS)
    picture = blank.with_stripes(
        [NamedStripe("left", stripe, orientation), NamedStripe("", stripe, orientation)]
    )
    assert picture.media_type == MESSAGE
    assert picture.message() is picture.data
    there = unpack(picture.data)
    parts = there.facts["parts"]
    for (laser, way, pixels, flags), name in zip(there.stripes(), ("left", ""), strict=True):
        assert (laser, way) == (name, orientation)
        assert np.abs(pixels - stripe.pixels).max(initial=0.0) <= 0.5 / parts + 1e-9
        assert np.array_equal(flags & 1 > 0, stripe.saturated)
        assert np.array_equal(np.cumsum(flags >> 1) - 1, stripe.segment)


@given(width=st.integers(1, 70), height=st.integers(1, 20), seed=st.integers(0, 99))
def test_a_mask_arrives_bit_for_bit(width: int, height: int, seed: int) -> None:
    mask = np.random.default_rng(seed).random((height, width)) < 0.3
    blank = LivePicture(Kind.MASK, b"", JPEG, 1, 0.0, (width, height))
    there = unpack(blank.with_bits(mask).data)
    assert there.code == 4
    assert np.array_equal(there.mask(), mask)


@pytest.mark.parametrize(
    "data", [b"", b"\x00\x01", b"\x00\x02" + bytes(20), b"\x00\x01\x00\x00\xff\x00\x00\x00{}"]
)
def test_something_else_is_no_message(data: bytes) -> None:
    with pytest.raises(ValueError, match="live message"):
        unpack(data)


def stripe_of(columns: list[float], orientation: Orientation) -> LaserStripe:
    n = len(columns)
    line = np.arange(n)
    across = np.array(columns, np.float64)
    pair = (across, line.astype(np.float64))
    ones = np.ones(n)
    return LaserStripe(
        np.column_stack(pair if orientation == "vertical" else pair[::-1]).reshape(-1, 2), line, ones, ones,
        ones, ones, (line // 7).astype(np.intp), line % 3 == 0,
    )  # fmt: skip
