"""A live picture as it goes to whoever looks, and the message that carries it with its numbers.

A message is, little-endian:

    u8   kind: 0 raw, 1 mask, 2 overlay, 3 stripe, 4 mask as packed bits
    u8   version: 1
    u16  nothing
    u32  length of the JSON that follows; a multiple of 8, spaces at its end
    JSON frame, exposed_s, size, is_stale, problem, numbers; where the kind is 3 also `stripes` and the
         `marks`: outlines, board and markers, each a list in pixels of the camera's frame
    body JPEG (kinds 0, 1, 2); positions (3); zlib of the packed bits (4)

Positions: for each entry of `stripes`, [laser, orientation, points], so many times three u16: line number,
position across in parts of a pixel (`parts` of them make one), and flags: 1 saturated, 2 a new piece begins.
A line is a row of the picture for a vertical stripe and a column for a horizontal one. Packed bits: rows from
the top, most significant bit first, each row filled up to whole bytes.
"""

import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.live.settings import Kind
from app.vision.overlay import Marks
from app.vision.stripe import LaserStripe, Orientation

JPEG = "image/jpeg"
MESSAGE = "application/vnd.turnscan.live"

_HEAD = struct.Struct("<BBHI")
_VERSION = 1
_CODES = {Kind.RAW: 0, Kind.MASK: 1, Kind.OVERLAY: 2, Kind.STRIPE: 3}
_PACKED_MASK = 4
_ALIGNED = 8
_SATURATED, _BEGINS = 1, 2
_LARGEST = 0xFFFF
_MOST_PARTS = 16


@dataclass(frozen=True, slots=True)
class LiveNumbers:
    """What a picture says in numbers.

    Attributes:
        points: of the stripes.
        saturated: how many of them are clipped.
        focus: variance of the Laplacian in the middle of the picture, grey levels squared; the larger the
            sharper, for one scene and exposure (Pech-Pacheco et al., Diatom autofocusing, 2000).
        histogram: share of the pixels in each of 64 bins of brightness, darkest first.
        exposure_us: how long the frame was exposed; None where the camera does not tell.
        corners: of the calibration board that were found, 0 where it is not looked for.
        markers: on the table that were found; likewise.
    """

    points: int
    saturated: int
    focus: float
    histogram: tuple[float, ...]
    exposure_us: float | None = None
    corners: int = 0
    markers: int = 0


@dataclass(frozen=True, slots=True)
class NamedStripe:
    """The stripe of one laser.

    Attributes:
        laser: its name; empty where it is not known which laser's it is.
        stripe: in pixels of the picture as the camera took it.
        orientation: which way it runs.
    """

    laser: str
    stripe: LaserStripe
    orientation: Orientation


@dataclass(frozen=True, eq=False, slots=True)
class LivePicture:
    """One picture for the eye.

    Attributes:
        kind: what it shows.
        data: a JPEG file, or a whole message where `media_type` is `MESSAGE`.
        media_type: of `data`.
        frame_index: number of the camera's frame; -1 where there never was one.
        exposed_s: monotonic time at which its exposure began.
        size: width and height of the camera's frame, pixels.
        numbers: what the frame says in numbers; None where nobody needed its pixels.
        is_stale: whether this is no picture of now, because none comes; `problem` says why.
        problem: a sentence; empty while all is well.
    """

    kind: Kind
    data: bytes
    media_type: str
    frame_index: int
    exposed_s: float
    size: tuple[int, int]
    numbers: LiveNumbers | None = None
    is_stale: bool = False
    problem: str = ""

    def message(self) -> bytes:
        """Picture and numbers in one piece, for a WebSocket; see the head of this file."""
        if self.media_type == MESSAGE:
            return self.data
        return _message(_CODES[self.kind], self._facts(), self.data)

    def with_stripes(self, stripes: Sequence[NamedStripe], marks: Marks | None = None) -> "LivePicture":
        """The same, whose data are the positions of these, and what else may be drawn over the picture."""
        parts = max(1, min(_MOST_PARTS, _LARGEST // max(self.size)))
        facts = self._facts() | {
            "parts": parts,
            "stripes": [[each.laser, each.orientation, len(each.stripe)] for each in stripes],
            "marks": _marked(marks or Marks()),
        }
        body = b"".join(_positions(each, parts).tobytes() for each in stripes)
        return self._carrying(_message(_CODES[Kind.STRIPE], facts, body))

    def with_bits(self, mask: NDArray[np.bool_]) -> "LivePicture":
        """The same, whose data are the bits of a mask (H, W)."""
        facts = self._facts() | {"mask_size": [mask.shape[1], mask.shape[0]]}
        return self._carrying(
            _message(_PACKED_MASK, facts, zlib.compress(np.packbits(mask, axis=1).tobytes(), 1))
        )

    def _carrying(self, data: bytes) -> "LivePicture":
        return LivePicture(
            self.kind, data, MESSAGE, self.frame_index, self.exposed_s, self.size, self.numbers,
            self.is_stale, self.problem,
        )  # fmt: skip

    def _facts(self) -> dict[str, Any]:
        numbers = self.numbers
        return {
            "frame": self.frame_index,
            "exposed_s": round(self.exposed_s, 6),
            "size": list(self.size),
            "is_stale": self.is_stale,
            "problem": self.problem,
            "numbers": None
            if numbers is None
            else {
                "points": numbers.points,
                "saturated": numbers.saturated,
                "focus": round(numbers.focus, 2),
                "histogram": [round(share, 5) for share in numbers.histogram],
                "exposure_us": None if numbers.exposure_us is None else round(numbers.exposure_us, 1),
                "corners": numbers.corners,
                "markers": numbers.markers,
            },
        }


@dataclass(frozen=True, eq=False, slots=True)
class Unpacked:
    """A message, taken apart.

    Attributes:
        code: its kind, as the head of this file numbers them.
        facts: the JSON.
        body: what follows it.
    """

    code: int
    facts: dict[str, Any]
    body: bytes

    def stripes(self) -> list[tuple[str, Orientation, NDArray[np.float64], NDArray[np.uint16]]]:
        """Laser, orientation, positions (N, 2) as (u, v) px, and flags (N,) of each stripe."""
        triples = np.frombuffer(self.body, "<u2").reshape(-1, 3)
        found, at = [], 0
        for laser, orientation, points in self.facts["stripes"]:
            line, across, flags = triples[at : at + points].T
            at += points
            pair = (across / self.facts["parts"], line.astype(np.float64))
            pixels = np.column_stack(pair if orientation == "vertical" else pair[::-1])
            found.append((laser, orientation, pixels, flags))
        return found

    def mask(self) -> NDArray[np.bool_]:
        """The lit pixels (H, W) of a mask as packed bits."""
        width, height = self.facts["mask_size"]
        rows = np.frombuffer(zlib.decompress(self.body), np.uint8).reshape(height, -1)
        return np.unpackbits(rows, axis=1, count=width).astype(np.bool_)


def unpack(message: bytes) -> Unpacked:
    """Take a message apart.

    Raises:
        ValueError: it is none of this version.
    """
    if len(message) < _HEAD.size:
        raise ValueError("is too short for a live message")
    code, version, _, length = _HEAD.unpack_from(message)
    if version != _VERSION or _HEAD.size + length > len(message):
        raise ValueError("is no live message of version 1")
    ends = _HEAD.size + length
    return Unpacked(code, json.loads(message[_HEAD.size : ends]), message[ends:])


def _marked(marks: Marks) -> dict[str, Any]:
    """Corners to a tenth of a pixel, lines to a whole one; parts of lines that are nowhere are left out."""
    board, markers = marks.board, marks.markers
    return {
        "outlines": [np.rint(line[np.isfinite(line).all(axis=1)]).tolist() for line in marks.outlines],
        "board": []
        if board is None
        else [[int(n), *pair] for n, pair in zip(board.ids, board.corners.round(1).tolist(), strict=True)],
        "markers": []
        if markers is None
        else [[int(n), four] for n, four in zip(markers.ids, markers.corners.round(1).tolist(), strict=True)],
    }


def _message(code: int, facts: dict[str, Any], body: bytes) -> bytes:
    text = json.dumps(facts, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % _ALIGNED)
    return _HEAD.pack(code, _VERSION, 0, len(text)) + text + body


def _positions(named: NamedStripe, parts: int) -> NDArray[np.uint16]:
    stripe = named.stripe
    across = stripe.pixels[:, 0 if named.orientation == "vertical" else 1]
    begins = np.diff(stripe.segment, prepend=-1) != 0
    flags = _SATURATED * stripe.saturated + _BEGINS * begins
    inside = np.clip(np.rint(parts * across), 0, _LARGEST)
    return np.column_stack([stripe.line, inside, flags]).astype("<u2")
