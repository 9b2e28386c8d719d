"""What a calibration hands to the person: the record, how well each view fits, and plain sentences."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.calibration.coverage import Coverage
from app.calibration.record import CalibrationRecord
from app.geometry.arrays import Floats
from app.recording.shot import Role


@dataclass(frozen=True, eq=False, slots=True)
class ViewResidual:
    """How one view fits.

    Attributes:
        name: the frame.
        role: what it was taken for.
        corner_px: RMS of its reprojected corners; NaN where it shows none.
        stripe_px: RMS of each laser's stripe points to the laser plane, across the stripe; empty where
            the method does not tell.
        stripe_mm: the same in mm.
        angle_deg: table angle that was solved for, counter-clockwise; NaN for a free view.
        commanded_deg: as the recording has it, counter-clockwise; NaN where unknown.
    """

    name: str
    role: Role
    corner_px: float
    stripe_px: Mapping[str, float]
    stripe_mm: Mapping[str, float]
    angle_deg: float
    commanded_deg: float

    @property
    def angle_error_deg(self) -> float:
        """Solved minus commanded, -180..180."""
        return (self.angle_deg - self.commanded_deg + 180.0) % 360.0 - 180.0


@dataclass(frozen=True, eq=False, slots=True)
class CalibrationOutcome:
    """A calibration and everything that its report shows.

    Attributes:
        record: what is saved.
        camera_sigma: (9,) standard deviations of fx, fy, cx, cy, k1, k2, p1, p2, k3; zero where held.
        coverage: where in the picture the corners of the board were.
        corner_pixels: (N, 2) corners of boards.
        corner_residuals: (N, 2) measured minus predicted, px.
        views: how each view fits.
        noise_px: noise seen in each group of observations.
        chi: RMS of residuals over assumed noise; NaN where the method has none.
        axis_method: line, board, platter or joint; empty where no axis was found.
        dropped: views and frames left out, and why.
        notes: what the person should know.
        doubts: why the result must not be trusted; empty where it can.
    """

    record: CalibrationRecord
    camera_sigma: Floats
    coverage: Coverage
    corner_pixels: Floats
    corner_residuals: Floats
    views: tuple[ViewResidual, ...]
    noise_px: Mapping[str, float]
    chi: float
    axis_method: str
    dropped: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
