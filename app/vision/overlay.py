"""What is painted onto a picture for the eye: stripes, what is clipped, board, markers, outlines, words.

The colours are those of Okabe and Ito (Color Universal Design, 2008), which people with any kind of colour
vision tell apart; and nothing is told by colour alone, each thing has a shape of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels
from app.vision.board import BoardObservation
from app.vision.markers import MarkerObservation
from app.vision.stripe import Image, LaserStripe

_Colour = tuple[int, int, int]
_Points = NDArray[np.int32]

# Blue, green, red.
_SKY_BLUE: _Colour = (255, 200, 70)
_YELLOW: _Colour = (66, 228, 240)
_VERMILLION: _Colour = (0, 94, 213)
_ORANGE: _Colour = (0, 159, 230)
_GREEN: _Colour = (140, 200, 30)
_WHITE: _Colour = (255, 255, 255)
_BLACK: _Colour = (0, 0, 0)
_STRIPES = (_SKY_BLUE, _YELLOW, _GREEN, _ORANGE)

# OpenCV takes positions in sixteenths of a pixel.
_SHIFT = 4
_ONE = 1 << _SHIFT
# A position further out than this, in pictures, is not drawn: OpenCV counts in 32 bits.
_FAR = 4.0
_DOT_EVERY_PX = 14.0
_DASH_PX = 9.0
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_ELLIPSIS = "..."


@dataclass(frozen=True, eq=False, slots=True)
class Marks:
    """What is to be painted, all in pixels of the picture as the camera took it.

    Attributes:
        stripes: of the lasers, in colours of their own; clipped points are marked.
        board: corners, joined in the order of their numbers; the first has a ring and its number.
        markers: on the table, framed, with their numbers.
        outlines: (N, 2) pixels each, dashed; NaN interrupts one.
        captions: lines of words in the upper left corner.
    """

    stripes: tuple[LaserStripe, ...] = ()
    board: BoardObservation | None = None
    markers: MarkerObservation | None = None
    outlines: tuple[Pixels, ...] = ()
    captions: tuple[str, ...] = ()


def shrunk(image: Image, width: int | None) -> Image:
    """The picture with at most that many columns, never enlarged; the same array where nothing is to do."""
    height, full = image.shape[:2]
    if width is None or width >= full:
        return image
    size = (width, max(1, round(height * width / full)))
    # Averaging is quick for whole factors only.
    is_whole = full % width == 0 and height * width % full == 0
    how = cv2.INTER_AREA if is_whole else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)


def painted(image: Image, marks: Marks, width: int | None = None) -> Image:
    """A new BGR picture with the marks, at most `width` columns wide.

    Args:
        image: (H, W, 3) BGR or (H, W) grey; stays as it is.
        marks: in pixels of `image`.
        width: of the result; lines keep their thickness whatever it is.
    """
    small = shrunk(image, width)
    if small.ndim == 2:
        canvas = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), np.uint8)
    else:
        canvas = small.copy() if small is image else small
    pen = _Pen(canvas, canvas.shape[1] / image.shape[1])
    for outline in marks.outlines:
        pen.dashed(outline)
    if marks.markers is not None:
        pen.markers(marks.markers)
    if marks.board is not None:
        pen.board(marks.board)
    for stripe, colour in zip(marks.stripes, _STRIPES * len(marks.stripes), strict=False):
        pen.stripe(stripe, colour)
    pen.captions(marks.captions)
    return canvas


def with_notice(image: Image, lines: Sequence[str]) -> Image:
    """The picture dimmed, grey, and with words in its middle: it is not what the camera sees now."""
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    canvas = np.asarray(cv2.cvtColor(grey // 3, cv2.COLOR_GRAY2BGR), np.uint8)
    pen = _Pen(canvas, 1.0)
    step = pen.line_height
    top = canvas.shape[0] // 2 - step * len(lines) // 2
    for number, line in enumerate(lines):
        pen.words(line, top + number * step, is_centred=True)
    return canvas


class _Pen:
    """Draws onto one canvas, at one scale."""

    def __init__(self, canvas: Image, scale: float) -> None:
        self.canvas, self.scale = canvas, scale
        width = canvas.shape[1]
        self.text_scale = float(np.clip(width / 1300.0, 0.38, 1.2))
        self.thin = max(1, round(width / 900.0))
        self.line_height = round(34 * self.text_scale)

    def stripe(self, stripe: LaserStripe, colour: _Colour) -> None:
        if len(stripe) == 0:
            return
        points = self._placed(stripe.pixels)
        breaks = np.flatnonzero(np.diff(stripe.segment) != 0) + 1
        pieces = np.split(points, breaks)
        self._lines(pieces, _BLACK, self.thin + 2, is_smooth=False)
        self._lines(pieces, colour, self.thin)
        self._saturated(stripe, points)
        step = max(1, round(_DOT_EVERY_PX / max(self.scale, 1e-6)))
        for x, y in points[::step]:
            cv2.circle(self.canvas, (int(x), int(y)), (self.thin + 1) * _ONE, colour, -1, cv2.LINE_AA, _SHIFT)

    def _saturated(self, stripe: LaserStripe, points: _Points) -> None:
        """Clipped pieces thick with a white rim, and a bar beside them at the picture's edge."""
        which = np.flatnonzero(stripe.saturated)
        if len(which) == 0:
            return
        is_broken = (np.diff(which) > 1) | (np.diff(stripe.segment[which]) != 0)
        runs = np.split(points[which], np.flatnonzero(is_broken) + 1)
        # A single point has no length to be seen.
        runs = [run if len(run) > 1 else np.vstack([run - 4, run + 4]) for run in runs]
        bars = []
        # Lines follow each other along the axis that their number counts.
        along = (
            1 if abs(int(points[-1, 1]) - int(points[0, 1])) >= abs(int(points[-1, 0] - points[0, 0])) else 0
        )
        for run in runs:
            bar = run[[0, -1]].copy()
            bar[:, 1 - along] = (4 + 2 * self.thin) * _ONE
            bars.append(bar)
        for pieces, width in ((runs, self.thin + 2), (bars, 2 * self.thin + 2)):
            self._lines(pieces, _WHITE, width + 4, is_smooth=False)
            self._lines(pieces, _VERMILLION, width, is_smooth=False)

    def board(self, board: BoardObservation) -> None:
        if not board.is_found:
            return
        order = np.argsort(board.ids)
        points = self._placed(board.corners[order])
        self._lines([points], _BLACK, self.thin + 2, is_smooth=False)
        self._lines([points], _GREEN, self.thin)
        radius = (2 + 2 * self.thin) * _ONE
        for x, y in points:
            cv2.circle(self.canvas, (int(x), int(y)), radius, _BLACK, self.thin + 2, cv2.LINE_8, _SHIFT)
            cv2.circle(self.canvas, (int(x), int(y)), radius, _GREEN, self.thin, cv2.LINE_AA, _SHIFT)
        x, y = int(points[0, 0]), int(points[0, 1])
        cv2.circle(self.canvas, (x, y), 2 * radius, _WHITE, self.thin + 1, cv2.LINE_AA, _SHIFT)
        self._label(str(int(board.ids[order[0]])), x, y - 2 * radius - self.line_height * _ONE // 2, _WHITE)

    def markers(self, markers: MarkerObservation) -> None:
        for number, corners in zip(markers.ids, markers.corners, strict=True):
            points = self._placed(corners)
            frame = [np.vstack([points, points[:1]])]
            self._lines(frame, _BLACK, self.thin + 2, is_smooth=False)
            self._lines(frame, _ORANGE, self.thin)
            x, y = (int(value) for value in points.mean(axis=0))
            self._label(str(int(number)), x, y, _ORANGE)

    def dashed(self, outline: Pixels) -> None:
        """Dashes of equal length along the outline, as far as it is in or near the picture."""
        dashes: list[_Points] = []
        for piece in self._near(outline):
            long = np.linalg.norm(np.diff(piece, axis=0), axis=1)
            at = np.concatenate([[0.0], np.cumsum(long)])
            ends = np.arange(0.0, at[-1], _DASH_PX * max(1, self.thin))
            x, y = (np.interp(ends, at, piece[:, k]) for k in (0, 1))
            points = _sixteenths(np.column_stack([x, y]))
            dashes += list(points[: len(points) // 2 * 2].reshape(-1, 2, 2))
        self._lines(dashes, _BLACK, self.thin + 2, is_smooth=False)
        self._lines(dashes, _WHITE, self.thin, is_smooth=False)

    def captions(self, lines: Sequence[str]) -> None:
        for number, line in enumerate(lines):
            self.words(line, number * self.line_height)

    def words(self, line: str, top: int, *, is_centred: bool = False) -> None:
        """One line of words on a dark ground; what does not fit is cut off."""
        width = self.canvas.shape[1]
        text = line.encode("ascii", "replace").decode()
        (long, high), below = cv2.getTextSize(text, _FONT, self.text_scale, self.thin)
        while long > width - 8 and len(text) > len(_ELLIPSIS):
            text = text[: -len(_ELLIPSIS) - 1] + _ELLIPSIS
            (long, high), below = cv2.getTextSize(text, _FONT, self.text_scale, self.thin)
        left = max(0, (width - long - 8) // 2) if is_centred else 0
        ground = self.canvas[max(0, top) : max(0, top + self.line_height), left : left + long + 8]
        ground //= 4
        base = top + (self.line_height + high) // 2
        cv2.putText(
            self.canvas, text, (left + 4, base - below // 4), _FONT, self.text_scale, _WHITE, self.thin,
            cv2.LINE_AA,
        )  # fmt: skip

    def _label(self, text: str, x: int, y: int, colour: _Colour) -> None:
        """Words about a position in sixteenths, readable on any ground."""
        (long, high), _ = cv2.getTextSize(text, _FONT, self.text_scale, self.thin)
        at = (x // _ONE - long // 2, y // _ONE + high // 2)
        for ink, thickness in ((_BLACK, self.thin + 3), (colour, self.thin)):
            cv2.putText(self.canvas, text, at, _FONT, self.text_scale, ink, thickness, cv2.LINE_AA)

    def _lines(
        self, pieces: Sequence[_Points], colour: _Colour, thickness: int, *, is_smooth: bool = True
    ) -> None:
        kind = cv2.LINE_AA if is_smooth else cv2.LINE_8
        if pieces:
            cv2.polylines(self.canvas, list(pieces), False, colour, thickness, kind, _SHIFT)

    def _placed(self, pixels: Floats) -> _Points:
        return _sixteenths(self._scaled(pixels))

    def _scaled(self, pixels: Floats) -> Floats:
        """Pixel centres stay pixel centres."""
        scaled: Floats = (pixels + 0.5) * self.scale - 0.5
        return scaled

    def _near(self, outline: Pixels) -> list[Floats]:
        """The pieces of an outline without gaps and without what is far outside of the picture."""
        points = self._scaled(outline)
        far = _FAR * max(self.canvas.shape[:2])
        with np.errstate(invalid="ignore"):
            is_near = (np.abs(points) < far).all(axis=1)
        pieces = np.split(points, np.flatnonzero(np.diff(is_near)) + 1)
        first = 0 if len(is_near) and is_near[0] else 1
        return [piece for piece in pieces[first::2] if len(piece) > 1]


def _sixteenths(points: Floats) -> _Points:
    return np.rint(points * _ONE).astype(np.int32)
