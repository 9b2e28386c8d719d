"""What a simulated bench is to be like, planted faults included; plain values, a table of a bench file."""

import math
from dataclasses import dataclass, replace

from app.errors import OptionError
from app.simulation.noise import Noise
from app.simulation.rig import SimulatedRig, standard_rig
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec

_SATURATED_GREY = 2500.0


@dataclass(frozen=True, slots=True)
class WorldPlan:
    """A simulated bench.

    Attributes:
        dialect: of the controller board, as `FIRMWARES` knows it.
        object: what is scanned: one of `object_names()`, or a path ending in .stl, .obj or .ply.
        object_size_mm: its largest extent; None for its usual one.
        width: columns of the camera's pictures.
        height: rows.
        fps: pictures per second of the camera.
        rate: world seconds in one of ours; above 1 everything happens faster.
        platter: markers on the table.
        board: that the hands hold; None for one that fits the picture.
        jpeg_quality: of the camera's pictures, 1..100.
        speckle: contrast of the lasers' speckle.
        read_noise: of the sensor, grey levels.
        seed: of noise and poses.
        resets_on_open: whether opening its port resets the board.
        wrong_direction: the motor is wired the other way round.
        steps_per_turn: of the mechanics, in the board's pulses; None for those that the dialect expects.
        play_deg: of the table's gear.
        swapped_lasers: the lasers are plugged in the wrong way round.
        camera_latency_s: from the end of an exposure until the picture arrives.
        stale_frames: pictures that wait in the camera and come first when nobody has read for a while.
        saturated: the lasers are far too bright for the standard exposure.
        has_timestamps: whether the camera tells when a picture was exposed.
    """

    dialect: str = "horus"
    object: str = "mug"
    object_size_mm: float | None = None
    width: int = 1280
    height: int = 720
    fps: float = 30.0
    rate: float = 1.0
    platter: PlatterSpec | None = None
    board: BoardSpec | None = None
    jpeg_quality: int = 92
    speckle: float = 0.12
    read_noise: float = 0.7
    seed: int = 0
    resets_on_open: bool = True
    wrong_direction: bool = False
    steps_per_turn: float | None = None
    play_deg: float = 0.0
    swapped_lasers: bool = False
    camera_latency_s: float = 0.0
    stale_frames: int = 0
    saturated: bool = False
    has_timestamps: bool = True

    def __post_init__(self) -> None:
        if not (64 <= self.width <= 4096 and 48 <= self.height <= 4096):
            raise OptionError(
                f"A simulated camera cannot have {self.width} x {self.height} pixels.",
                "Give a width from 64 and a height from 48, both up to 4096.",
            )
        limits = (
            ("fps", self.fps, 0.1, 1000.0),
            ("rate", self.rate, 0.01, 1000.0),
            ("jpeg_quality", self.jpeg_quality, 1, 100),
            ("seed", self.seed, 0, 2**63 - 1),
            ("play_deg", self.play_deg, 0.0, 90.0),
            ("camera_latency_s", self.camera_latency_s, 0.0, 5.0),
            ("stale_frames", self.stale_frames, 0, 100),
            ("steps_per_turn", self.steps_per_turn or 1.0, 1.0, 1e8),
        )
        for name, value, lowest, highest in limits:
            if not (math.isfinite(value) and lowest <= value <= highest):
                raise OptionError(
                    f"A simulated bench cannot have {name} = {value:g}.",
                    f"Give a number from {lowest:g} to {highest:g}.",
                )
        # A value that cannot be is named here, before anything is built.
        self.noise  # noqa: B018

    @property
    def noise(self) -> Noise:
        """Of the sensor at a gain of one."""
        return Noise(self.speckle, read_grey=self.read_noise)

    @property
    def scanner(self) -> SimulatedRig:
        """The true rig."""
        rig = standard_rig(self.width, self.height)
        if not self.saturated:
            return rig
        sources = {name: replace(source, peak_grey=_SATURATED_GREY) for name, source in rig.sources.items()}
        return SimulatedRig(rig.rig, sources, rig.table_radius_mm)
