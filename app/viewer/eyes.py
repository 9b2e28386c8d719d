"""From where the scene is looked at."""

import math
from typing import Literal, TypeAlias, get_args

import numpy as np

from app.errors import OptionError
from app.geometry.arrays import Vector3
from app.geometry.transform import RigidTransform

Preset: TypeAlias = Literal["home", "top", "front", "back", "left", "right", "camera"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

FOV_RAD = math.radians(42.0)
NEAR_MM, FAR_MM = 1.0, 6000.0
# Azimuth and elevation in degrees; the camera of the scanner stands at azimuth 0.
_DIRECTIONS: dict[str, tuple[float, float]] = {
    "home": (-65.0, 28.0),
    "top": (0.0, 89.9),
    "front": (0.0, 8.0),
    "back": (180.0, 8.0),
    "left": (-90.0, 8.0),
    "right": (90.0, 8.0),
}


def place(
    preset: str, radius_mm: float, height_mm: float, world_from_camera: RigidTransform | None
) -> tuple[Vector3, Vector3]:
    """Where to stand and what to look at, mm in the table frame.

    Args:
        preset: one of `PRESETS`.
        radius_mm, height_mm: of what is looked at.
        world_from_camera: where the scanner's camera is, if that is known.

    Raises:
        OptionError: there is no such preset, or no camera yet.
    """
    middle = np.array([0.0, 0.0, height_mm / 3.0])
    if preset == "camera":
        if world_from_camera is None:
            raise OptionError("The scanner has not been calibrated, so its camera has no place.")
        eye, forward = world_from_camera.translation, world_from_camera.rotation[:, 2]
        return eye, eye + forward * max(1.0, float((middle - eye) @ forward))
    if preset not in _DIRECTIONS:
        raise OptionError(f"There is no view called {preset!r}.", f"Choose one of: {', '.join(PRESETS)}.")
    azimuth, elevation = np.radians(_DIRECTIONS[preset])
    reach = math.hypot(radius_mm, height_mm / 2.0) * 1.15 / math.tan(FOV_RAD / 2.0)
    outward = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    return middle + reach * outward, middle
