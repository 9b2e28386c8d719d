"""The true angle of the table at every stop, and how far it was from where it should have been."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.geometry.arrays import Floats
from app.geometry.platter import MarkerLayout, SeenMarkers, angle_from_markers
from app.geometry.rig import Rig

NominalAngles = Literal["commanded angle", "constant speed"]

# Markers that fit worse than this are something else, px.
_WORST_FIT_PX = 5.0
# A stop is out of place when it is off by this and by several times what is usual, degrees.
_NOTABLE_DEG = 0.3
_NOTABLE_SIGMAS = 5.0
_MAD_TO_SIGMA = 1.4826
_JUMPS_TOLD = 3


@dataclass(frozen=True, slots=True)
class AngleSummary:
    """Where the angles came from.

    Attributes:
        source: `markers` where any were seen; else where the nominal angles are from.
        stops: how many stops there were.
        stops_with_markers: how many of them showed their true angle.
        marker_rms_px: distance of the corners to where the layout has them, median over the stops; NaN
            without markers.
        largest_deg: largest distance of the true angle from the nominal one; 0 without markers. A turn
            common to all stops (their median) does not count.
        rms_deg: the same, RMS.
        sentence: what a person should know about it; empty where all is well.
    """

    source: str
    stops: int
    stops_with_markers: int
    marker_rms_px: float
    largest_deg: float
    rms_deg: float
    sentence: str


class AngleReader:
    """Reads the angle of one stop after the other.

    A stop whose markers are not seen is taken to be off its nominal angle as much as the stop before.

    Args:
        rig: the calibrated scanner.
        layout: where the markers lie; empty where there are none.
        nominal: where the nominal angles are from.
        offset_rad: how far the first stops are off, where they show no markers.
        direction: 1 where recorded angles grow counter-clockwise, -1 where clockwise.
    """

    def __init__(
        self,
        rig: Rig,
        layout: MarkerLayout,
        nominal: NominalAngles = "commanded angle",
        offset_rad: float = 0.0,
        direction: float = 1.0,
    ) -> None:
        self.rig, self.layout, self.nominal = rig, layout, nominal
        self.offset_rad, self.direction = offset_rad, direction
        self._stops: list[int] = []
        self._offsets: list[float] = []
        self._fits_px: list[float] = []
        self._count = 0

    def read(self, turn_rad: float, markers: SeenMarkers) -> float:
        """The true angle of the next stop, from its nominal one and what is seen of the markers."""
        angle, rms_px = angle_from_markers(self.rig.camera, self.rig.axis, self.layout, markers)
        if np.isfinite(angle) and rms_px <= _WORST_FIT_PX:
            off = float(np.angle(np.exp(1j * (angle - turn_rad))))
            self.offset_rad = off
            self._stops.append(self._count)
            self._offsets.append(off)
            self._fits_px.append(rms_px)
        self._count += 1
        return turn_rad + self.offset_rad

    def summary(self) -> AngleSummary:
        """What was found so far."""
        if not self._stops:
            return AngleSummary(self.nominal, self._count, 0, float("nan"), 0.0, 0.0, "")
        off_deg: Floats = np.degrees(np.unwrap(np.array(self._offsets)))
        off_deg = self.direction * (off_deg - np.median(off_deg))
        sentence = _described(np.array(self._stops), off_deg, self._count, self.nominal)
        return AngleSummary(
            "markers", self._count, len(self._stops), float(np.median(self._fits_px)),
            float(np.max(np.abs(off_deg))), float(np.sqrt(np.mean(off_deg**2))), sentence,
        )  # fmt: skip


def _described(stops: Floats, off_deg: Floats, count: int, nominal: str) -> str:
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(off_deg)))
    limit = max(_NOTABLE_DEG, _NOTABLE_SIGMAS * sigma)
    is_off = np.abs(off_deg) > limit
    if not is_off.any():
        return ""
    first, last = stops[is_off][[0, -1]]
    behind, ahead = -float(off_deg.min()), float(off_deg.max())
    how_far = [
        f"up to {size:.1f} degrees {side}"
        for size, side in ((behind, "behind"), (ahead, "ahead of"))
        if size > limit
    ]
    text = (
        f"The table stood {' and '.join(how_far)} the {nominal} at "
        f"{np.count_nonzero(is_off)} of {count} stops, the first being number {first:.0f} and "
        f"the last {last:.0f}"
    )
    step = np.diff(off_deg)
    lost = [k for k in np.argsort(step) if step[k] < -limit]
    if lost:
        told = sorted(lost[:_JUMPS_TOLD])
        jumps = ", ".join(f"{-step[k]:.2f} before stop {stops[k + 1]}" for k in told)
        text += f"; the motor lost steps: {jumps} (degrees)"
    return text + "."
