"""A deviation map as a picture: three sides, and the histogram with its colours."""

import cv2
import numpy as np

from app.surface.measure.deviation_map import DeviationMap, deviation_colours
from app.surface.preview import PreviewPainter
from app.surface.splat import PAPER, Canvas

_HEIGHT_PX, _MARGIN_PX, _AXIS_PX = 170, 60, 40
_TEXT = (60, 54, 48)


def deviation_picture(found: DeviationMap) -> Canvas:
    """(H, W, 3) BGR."""
    painter = PreviewPainter()
    painter.add(found.cloud)
    panels = painter.image()
    return np.vstack([panels, _histogram(found, panels.shape[1])])


def _histogram(found: DeviationMap, width: int) -> Canvas:
    canvas = np.empty((_HEIGHT_PX, width, 3), np.uint8)
    canvas[:] = PAPER
    middles = (found.edges_mm[1:] + found.edges_mm[:-1]) / 2.0
    colours = deviation_colours(middles, found.scale_mm)[:, ::-1]
    across = np.linspace(_MARGIN_PX, width - _MARGIN_PX, len(found.edges_mm)).astype(int)
    floor = _HEIGHT_PX - _AXIS_PX
    tallest = max(int(found.counts.max()), 1)
    for left, right, count, colour in zip(across, across[1:], found.counts, colours.tolist(), strict=False):
        top = floor - round((floor - 12) * int(count) / tallest)
        cv2.rectangle(canvas, (int(left), top), (int(right) - 1, floor), colour, cv2.FILLED)
        cv2.rectangle(canvas, (int(left), floor + 2), (int(right) - 1, floor + 10), colour, cv2.FILLED)
    for share in np.linspace(0.0, 1.0, 5):
        value = found.edges_mm[0] + share * (found.edges_mm[-1] - found.edges_mm[0])
        x = int(across[0] + share * (across[-1] - across[0]))
        sign = "+" if found.has_sign else ""
        words = f"{value:{sign}.3g} mm" if abs(value) > 1e-9 else "0 mm"
        cv2.putText(
            canvas, words, (x - 34, _HEIGHT_PX - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _TEXT, 1, cv2.LINE_AA
        )
    return canvas
