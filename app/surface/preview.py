"""A picture of the cloud from three sides, for the eyes."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import OutputError
from app.files import write_whole
from app.geometry.arrays import Floats, Vector3
from app.geometry.cloud import PointCloud
from app.surface.neighbours import is_finite
from app.surface.splat import PAPER, Canvas, View, splatted

_X, _Y, _Z = np.eye(3)
VIEWS = (
    View("front", _Y, _Z, ("y", "z")),
    View("side", _X, _Z, ("x", "z")),
    View("top", _Y, -_X, ("y", "-x")),
)
"""The front faces the camera at table angle 0; in the top view the camera is below."""

_PANEL_PX = 620
_FINER = 2
_FILLED = 0.86
_FOOTER_PX = 46
_OUTLIERS = 0.002
_INK, _FAINT, _TEXT = (70, 64, 58), (226, 222, 218), (60, 54, 48)


class PreviewPainter:
    """Collects an even choice of a growing cloud and paints it.

    Args:
        limit: points that are kept at most; the memory this takes does not grow with the cloud.
    """

    def __init__(self, limit: int = 400_000) -> None:
        self.limit = limit
        self._points = 0
        self._stride = 1
        self._kept: list[PointCloud] = []
        self._kept_points = 0

    def add(self, cloud: PointCloud) -> None:
        """More points; those whose positions are not finite are left out."""
        cloud = cloud.select(is_finite(cloud.points))
        if not len(cloud):
            return
        first = -self._points % self._stride
        self._points += len(cloud)
        chosen = cloud.select(np.arange(first, len(cloud), self._stride))
        self._kept.append(chosen)
        self._kept_points += len(chosen)
        while self._kept_points > self.limit:
            every_other = np.arange(0, self._kept_points, 2)
            self._kept = [PointCloud.joined(self._kept).select(every_other)]
            self._kept_points = len(every_other)
            self._stride *= 2

    def image(self) -> Canvas:
        """Three panels side by side (H, W, 3) BGR."""
        cloud = PointCloud.joined(self._kept)
        if not len(cloud):
            return _with_footer(np.hstack([_blank()] * len(VIEWS)), "no points", np.zeros(3))
        centre, extent = _bounds(cloud.points)
        panels = [_panel(cloud, view, centre, _scale(extent)) for view in VIEWS]
        return _with_footer(np.hstack(panels), f"{self._points:,} points".replace(",", " "), extent)

    def panel(self, view: View) -> Canvas:
        """One of the panels alone, square."""
        cloud = PointCloud.joined(self._kept)
        if not len(cloud):
            return _blank()
        centre, extent = _bounds(cloud.points)
        return _panel(cloud, view, centre, _scale(extent))

    def write(self, path: Path) -> None:
        """The picture as PNG.

        Raises:
            OutputError: it cannot be written.
        """
        write_picture(path, self.image())


def write_picture(path: Path, image: Canvas) -> None:
    """A picture as PNG, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    is_encoded, data = cv2.imencode(".png", image)
    if not is_encoded:
        raise OutputError(str(path), "the picture could not be encoded")
    write_whole(path, data.tobytes(), is_durable=False)


def _bounds(points: NDArray[np.float32]) -> tuple[Vector3, Vector3]:
    """Middle and size of the box that holds all but a few stray points."""
    low, high = np.quantile(points, [_OUTLIERS, 1.0 - _OUTLIERS], axis=0).astype(np.float64)
    return (low + high) / 2.0, high - low


def _scale(extent: Vector3) -> float:
    """Millimetres to a pixel of a panel."""
    return float(max(extent.max(), 1e-3)) / (_FILLED * _PANEL_PX)


def _panel(cloud: PointCloud, view: View, centre: Vector3, mm_per_px: float) -> Canvas:
    fine = _FINER * _PANEL_PX
    drawn = splatted(cloud, view, centre, mm_per_px / _FINER, (fine, fine))
    panel = cv2.resize(drawn, (_PANEL_PX, _PANEL_PX), interpolation=cv2.INTER_AREA).astype(np.uint8)
    _draw_axes(panel, view)
    _draw_scale(panel, mm_per_px)
    cv2.putText(panel, view.name, (18, 34), cv2.FONT_HERSHEY_DUPLEX, 0.8, _TEXT, 1, cv2.LINE_AA)
    cv2.rectangle(panel, (0, 0), (_PANEL_PX - 1, _PANEL_PX - 1), _FAINT, 1)
    return panel


def _draw_axes(panel: Canvas, view: View) -> None:
    x, y, length = 22, _PANEL_PX - 22, 34
    for (dx, dy), label in zip(((length, 0), (0, -length)), view.labels, strict=True):
        cv2.arrowedLine(panel, (x, y), (x + dx, y + dy), _INK, 1, cv2.LINE_AA, tipLength=0.2)
        at = (x + dx + (6 if dx else -4), y + dy + (4 if dx else -6))
        cv2.putText(panel, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _TEXT, 1, cv2.LINE_AA)


def _draw_scale(panel: Canvas, mm_per_px: float) -> None:
    length_mm = _round_length(0.25 * _PANEL_PX * mm_per_px)
    length = round(length_mm / mm_per_px)
    right, y = _PANEL_PX - 22, _PANEL_PX - 22
    left = right - length
    cv2.line(panel, (left, y), (right, y), _INK, 2, cv2.LINE_AA)
    for x in (left, right):
        cv2.line(panel, (x, y - 5), (x, y + 5), _INK, 2, cv2.LINE_AA)
    text = f"{length_mm:g} mm"
    (text_width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    at = ((left + right - text_width) // 2, y - 10)
    cv2.putText(panel, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _TEXT, 1, cv2.LINE_AA)


def _round_length(length_mm: float) -> float:
    """1, 2 or 5 times a power of ten, not longer than given."""
    power = 10.0 ** np.floor(np.log10(length_mm))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length_mm * 1.0001))


def _with_footer(panels: Canvas, text: str, extent: Floats) -> Canvas:
    footer = np.empty((_FOOTER_PX, panels.shape[1], 3), np.uint8)
    footer[:] = PAPER
    size = " x ".join(f"{length:.1f}" for length in extent)
    line = f"{text}   x, y, z: {size} mm"
    cv2.putText(footer, line, (18, 29), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _TEXT, 1, cv2.LINE_AA)
    return np.vstack([panels, footer])


def _blank() -> Canvas:
    panel = np.empty((_PANEL_PX, _PANEL_PX, 3), np.uint8)
    panel[:] = PAPER
    return panel
