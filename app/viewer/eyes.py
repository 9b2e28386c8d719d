"""From where the scene is looked at."""

import math
from typing import Literal, TypeAlias, get_args

import numpy as np

from app.errors import OptionError
from app.geometry.arrays import Vector3
from app.geometry.transform import RigidTransform
from app.viewer.stage import FRUSTUM_MM

Preset: TypeAlias = Literal["home", "top", "front", "back", "left", "right", "scanner", "camera"]
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
    reach = math.hypot(radius_mm, height_mm / 2.0) * 1.15 / math.tan(FOV_RAD / 2.0)
    if preset in ("camera", "scanner"):
        if world_from_camera is None:
            raise OptionError("The scanner has not been calibrated, so its camera has no place.")
        camera, forward = world_from_camera.translation, world_from_camera.rotation[:, 2]
        if preset == "camera":
            # Its own picture hangs before it and would hide everything.
            eye = camera + forward * 1.1 * FRUSTUM_MM
            return eye, eye + forward * max(1.0, float((middle - eye) @ forward))
        between = (middle + camera) / 2.0
        farther = 0.45 * reach + 0.9 * float(np.linalg.norm(camera - middle))
        return between + farther * _outward(-70.0, 32.0), between
    if preset not in _DIRECTIONS:
        raise OptionError(f"There is no view called {preset!r}.", f"Choose one of: {', '.join(PRESETS)}.")
    return middle + reach * _outward(*_DIRECTIONS[preset]), middle


def _outward(azimuth_deg: float, elevation_deg: float) -> Vector3:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    flat = math.cos(elevation)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
