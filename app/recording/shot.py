"""A frame with what the rig did while it was taken."""

from dataclasses import dataclass
from enum import StrEnum

from app.vision.stripe import Image


class Role(StrEnum):
    """What a frame is for; see the recording format."""

    INTRINSICS = "intrinsics"
    LASER_PLANE = "laser_plane"
    AXIS = "axis"
    AXIS_LINE = "axis_line"
    SCAN = "scan"
    TEXTURE = "texture"
    BACKGROUND = "background"


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """A frame with its circumstances.

    Attributes:
        image: the picture, (H, W, 3) BGR or (H, W) grey.
        role: what it is for.
        lasers_on: names of the lasers that were lit.
        angle_deg: table angle as the recording counts it (see `turntable.direction`); None where unknown.
        pose: number of the board's placement.
        time_s: monotonic capture time.
        exposure_us: exposure time.
        name: the frame's file in its recording, for messages; empty for a frame not yet written.
    """

    image: Image
    role: Role
    lasers_on: tuple[str, ...] = ()
    angle_deg: float | None = None
    pose: int | None = None
    time_s: float | None = None
    exposure_us: float | None = None
    name: str = ""
