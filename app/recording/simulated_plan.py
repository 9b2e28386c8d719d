"""What a simulated recording is to show."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from app.errors import OptionError
from app.geometry.arrays import Floats
from app.geometry.transform import RigidTransform, rotation_about
from app.recording.manifest import Direction
from app.recording.picture import ImageFormat
from app.simulation.noise import Noise
from app.simulation.objects import SimulatedObject, sphere
from app.simulation.poses import tipped_pose
from app.simulation.rig import Z_UP, SimulatedRig, standard_rig
from app.simulation.scene import Lighting
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec


@dataclass(frozen=True, slots=True)
class AngleError:
    """How the platform misses the angles it was told.

    Attributes:
        jitter_deg: standard deviation of every stop, independent.
        lost_steps: how often in one turn the motor misses a step and stays behind from then on.
        lost_deg: how much each time.
    """

    jitter_deg: float = 0.02
    lost_steps: int = 0
    lost_deg: float = 0.45

    def reached_deg(self, told_deg: Floats, rng: np.random.Generator) -> Floats:
        """Where the platform really stood at (N,) angles."""
        count = len(told_deg)
        behind = np.zeros(count)
        for stop in rng.integers(0, max(count, 1), self.lost_steps):
            behind[stop:] += self.lost_deg
        reached: Floats = told_deg - behind + self.jitter_deg * rng.standard_normal(count)
        return reached


@dataclass(frozen=True, slots=True)
class Views:
    """How many calibration views there are.

    Attributes:
        intrinsics: free poses of the board.
        laser_plane: free poses with every laser.
        placements: of the board on the table, beside the axis.
        angles_deg: where the table stops for each placement.
        axis_line: placements of the board through the axis, with the first laser along it (the paper's
            method); that laser is then turned to shine through the axis.
        hand_mm: standard deviation with which board and laser are placed through the axis.
        hand_deg: the same for their tilt.
    """

    intrinsics: int = 20
    laser_plane: int = 10
    placements: int = 2
    angles_deg: tuple[float, ...] = (-28.0, -14.0, 0.0, 14.0, 28.0)
    axis_line: int = 0
    hand_mm: float = 0.0
    hand_deg: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class SimulationPlan:
    """Everything that a simulated recording depends on.

    Attributes:
        scanner: the true rig.
        item: what is scanned.
        at_mm: (x, y) where its middle stands on the table, beside the axis; None for a little off it.
        tilt_deg: how far it is tipped over: 90 for lying, 180 for upside down. It rests on its lowest point.
        board: for the calibration; None for one that fits the rig.
        platter: markers on the table.
        parts: calibration frames, scan frames, or both.
        views: of the calibration.
        steps: stops in one turn of the scan.
        texture_every: a frame with all lasers off at every n-th stop; 0 for none.
        background_steps: stops of a turn of the empty table, before the scan.
        lasers: that scan; all of the rig where empty.
        seconds_per_turn: 0 for a table that stops for every frame; above, it turns steadily, frames have a
            time instead of an angle, and one laser stays on.
        direction: which way the table turns as angles grow, seen from above.
        angle_error: of the platform.
        lighting: of the room.
        noise: of the sensor.
        is_grey: a camera without colours.
        image_format: of the frames.
        quality: of JPEG frames.
        seed: same plan, same seed, same bytes.
    """

    scanner: SimulatedRig = field(default_factory=standard_rig)
    item: SimulatedObject = field(default_factory=sphere)
    at_mm: tuple[float, float] | None = None
    tilt_deg: float = 0.0
    board: BoardSpec | None = None
    platter: PlatterSpec | None = None
    parts: tuple[Literal["calibration", "scan"], ...] = ("calibration", "scan")
    views: Views = field(default_factory=Views)
    steps: int = 400
    texture_every: int = 1
    background_steps: int = 0
    lasers: tuple[str, ...] = ()
    seconds_per_turn: float = 0.0
    direction: Direction = "ccw"
    angle_error: AngleError = field(default_factory=AngleError)
    lighting: Lighting = field(default_factory=Lighting)
    noise: Noise = field(default_factory=Noise)
    is_grey: bool = False
    image_format: ImageFormat = "png"
    quality: int = 95
    seed: int = 0

    def __post_init__(self) -> None:
        known = self.scanner.rig.lasers
        for name in self.lasers:
            if name not in known:
                raise OptionError(f"There is no laser called {name!r}.", f"Choose from: {', '.join(known)}.")
        if self.steps < 1 or self.texture_every < 0 or self.background_steps < 0 or self.seed < 0:
            raise OptionError("Steps and the seed of a simulation must not be negative.")
        if not np.isfinite(self.tilt_deg):
            raise OptionError("An object must be tipped over by some degrees.")
        if not (np.isfinite(self.seconds_per_turn) and self.seconds_per_turn >= 0.0):
            raise OptionError("The table's time for a turn must be zero or more seconds.")
        if self.seconds_per_turn > 0.0 and len(self.scanning_lasers) != 1:
            raise OptionError(
                "A table that turns steadily is scanned with one laser.",
                f"Name one of: {', '.join(known)}.",
            )
        if not 1 <= self.quality <= 100:
            raise OptionError(f"A JPEG cannot have the quality {self.quality}.", "Give 1 to 100.")
        if not self.parts:
            raise OptionError("A recording needs calibration frames, scan frames or both.")

    def as_set_up(self) -> "SimulationPlan":
        """The plan with the first laser turned to the axis by hand, where the paper's method needs it."""
        views, rng = self.views, self.rng("laser by hand")
        if views.axis_line == 0:
            return self
        first = next(iter(self.scanner.rig.lasers))
        miss_mm = views.hand_mm * float(rng.standard_normal())
        lean_rad = float(np.radians(views.hand_deg)) * float(rng.standard_normal())
        return replace(self, scanner=self.scanner.aimed(first, miss_mm, lean_rad))

    @property
    def scanning_lasers(self) -> tuple[str, ...]:
        return self.lasers or tuple(self.scanner.rig.lasers)

    @property
    def turn_sign(self) -> float:
        """From recorded angles to counter-clockwise ones."""
        return 1.0 if self.direction == "ccw" else -1.0

    @property
    def table_from_item(self) -> RigidTransform:
        """Where the object stands at table angle 0."""
        radius = self.scanner.table_radius_mm
        x, y = (0.07 * radius, -0.04 * radius) if self.at_mm is None else self.at_mm
        place, turned = np.array([x, y, 0.0]), rotation_about(Z_UP, 0.4)
        if not self.tilt_deg:
            return RigidTransform(turned, place)
        return tipped_pose(self.item.mesh.vertices, turned, place, self.tilt_deg)

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers of their own for every purpose, so that one option does not change another's."""
        return np.random.default_rng([self.seed, *purpose.encode()])
