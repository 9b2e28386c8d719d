"""Where the table stands, found by turning it until it looks as it did at a stop that is known."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.devices.bench import Bench
from app.devices.frame import Use
from app.geometry.arrays import Floats
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.scanning.exposure_stack import exposure_stack
from app.vision.stripe import Image

_PICTURE_S = 3.0
# Farther than this nobody wants to wait.
_WIDEST_DEG = 120.0
_COARSE_DEG, _FINE_DEG = 3.0, 0.4
_FINE_STEPS = 4
# The likeness must be told to better than this, or it tells nothing.
_SURE_DEG = 0.1
_COARSE_PX, _FINE_PX = 8.0, 2.0
_SMALLER = 2

Unlikeness = Callable[[float, float], float]
"""Mean square of the grey levels by which the picture at an angle (degrees, as the board counts) differs from
the one looked for, both blurred by so many pixels."""


@dataclass(frozen=True, slots=True)
class PictureFinder:
    """Compares pictures with the lasers off. What looks the same from all sides tells nothing.

    Attributes:
        folder: of the recording as it grows; it must have pictures with the lasers off.
        is_of_stack: its pictures have several exposures, and so the camera must be set to theirs.
    """

    folder: Path
    is_of_stack: bool = False

    def __call__(self, bench: Bench, low_deg: float, high_deg: float) -> float | None:
        """The angle at which the table then stands; None where pictures do not tell. Turns the table."""
        recording = Recording.open(self.folder)
        entry = _nearest_dark(recording, low_deg, high_deg)
        if entry is None or entry.angle_deg is None or high_deg - low_deg > _WIDEST_DEG:
            return None
        wanted = recording.load(entry, grey=True).image
        bench.camera.prepare(Use.LASER)
        is_set = self.is_of_stack and entry.exposure_us is not None
        with exposure_stack(bench.camera, [entry.exposure_us or 0.0] if is_set else []):
            return _found(bench, wanted, entry.angle_deg, low_deg, high_deg)


def _found(bench: Bench, wanted: Image, looked_deg: float, low_deg: float, high_deg: float) -> float | None:
    """As `PictureFinder`, with the camera as it was for the picture that is wanted."""
    bench.turntable.hold(True)
    # Believed to stand at the upper end, it is ahead of the truth by what is looked for, if at all.
    bench.turntable.zero(high_deg)

    def unlike(board_deg: float, blur_px: float) -> float:
        bench.turntable.move_to(board_deg)
        time.sleep(bench.description.turntable.settle_s)
        seen = bench.camera.fresh_frame(timeout_s=_PICTURE_S).image(grey=True)
        return float(np.mean((_blurred(seen, blur_px) - _blurred(wanted, blur_px)) ** 2))

    found_deg = most_alike(unlike, looked_deg, looked_deg + (high_deg - low_deg))
    if found_deg is None:
        return None
    ahead_deg = found_deg - looked_deg
    return bench.turntable.angle_deg - ahead_deg


def most_alike(unlike: Unlikeness, low_deg: float, high_deg: float) -> float | None:
    """The angle of the least difference, between two or just beside them; None where it is not distinct."""
    count = max(3, round((high_deg - low_deg) / _COARSE_DEG) + 3)
    coarse = np.linspace(low_deg - _COARSE_DEG / 2, high_deg + _COARSE_DEG / 2, count)
    best = _least(unlike, coarse, _COARSE_PX)
    reach = np.ceil((coarse[1] - coarse[0]) / _FINE_DEG)
    best = _least(unlike, best + _FINE_DEG * np.arange(-reach, reach + 1), _FINE_PX)
    near = np.array([best + 0.5 * _FINE_DEG * step for step in range(-_FINE_STEPS, _FINE_STEPS + 1)])
    return _bottom(near, np.array([unlike(angle, _FINE_PX) for angle in near]))


def _least(unlike: Unlikeness, angles_deg: Floats, blur_px: float) -> float:
    return float(min(angles_deg, key=lambda angle: unlike(angle, blur_px)))


def _bottom(angles_deg: Floats, differences: Floats) -> float | None:
    """Of the parabola through the differences; None where it is flat against their scatter."""
    middle = float(angles_deg.mean())
    terms = np.column_stack([(angles_deg - middle) ** 2, angles_deg - middle, np.ones(len(angles_deg))])
    fit, *_ = np.linalg.lstsq(terms, differences, rcond=None)
    scatter = float(np.sqrt(np.sum((terms @ fit - differences) ** 2) / (len(differences) - 3)))
    curve, slope = float(fit[0]), float(fit[1])
    if curve <= 0.0:
        return None
    bottom = -slope / (2.0 * curve)
    covariance = np.linalg.inv(terms.T @ terms) * scatter**2
    gradient = np.array([slope / (2.0 * curve**2), -1.0 / (2.0 * curve), 0.0])
    sigma_deg = float(np.sqrt(gradient @ covariance @ gradient))
    is_inside = abs(bottom) <= float(np.ptp(angles_deg)) / 2.0
    return middle + bottom if is_inside and sigma_deg < _SURE_DEG else None


def _nearest_dark(recording: Recording, low_deg: float, high_deg: float) -> FrameEntry | None:
    """The laser-off picture whose angle is known and that lies nearest to where the table may be."""
    dark = [entry for entry in recording.entries if not entry.lasers_on and entry.angle_deg is not None]
    middle = 0.5 * (low_deg + high_deg)
    return min(dark, key=lambda entry: abs((entry.angle_deg or 0.0) - middle), default=None)


def _blurred(image: Image, blur_px: float) -> NDArray[np.float32]:
    """Smaller, and blurred, so that a turn changes it smoothly."""
    small = cv2.resize(image, None, fx=1 / _SMALLER, fy=1 / _SMALLER, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small.astype(np.float32), (0, 0), blur_px), np.float32)
