"""Calibration files of Horus and FabScanPi for a known rig, and the points that those programs compute."""

from typing import Any

import cv2
import numpy as np

from app.calibration.record import CalibrationRecord
from app.geometry.arrays import Floats, Matrix3, Pixels, Points
from app.geometry.rig import Rig

ANGLES_DEG = (0.0, 33.0, 200.0)


def platform_rotation(rig: Rig) -> Matrix3:
    """As both programs build it from the normal of the circle: two vectors across, then the normal."""
    n = rig.axis.direction
    s = np.cross([1.0, 0.0, 0.0], n)
    s /= np.linalg.norm(s)
    return np.column_stack([s, np.cross(n, s), n])


def horus_file(rig: Rig, *, flips: tuple[bool, bool, bool] = (True, True, False)) -> dict[str, Any]:
    """The calibration of a rig whose picture Horus has made by rotate, hflip and vflip."""
    rotate, hflip, vflip = flips
    width, height = rig.camera.size[::-1] if rotate else rig.camera.size
    values: dict[str, object] = {
        "settings_version": 1,
        "pattern_rows": 6,
        "pattern_columns": 11,
        "pattern_square_width": 13.0,
        "pattern_origin_distance": 38.5,
        "camera_width": width,
        "camera_height": height,
        "camera_rotate": rotate,
        "camera_hflip": hflip,
        "camera_vflip": vflip,
        "camera_matrix": rig.camera.matrix.tolist(),
        "distortion_vector": rig.camera.distortion.tolist(),
        "use_distortion": bool(rig.camera.distortion.any()),
        "adjust_laser": True,
        "rotation_matrix": platform_rotation(rig).tolist(),
        "translation_vector": rig.axis.origin.tolist(),
        "estimated_size": [-5.0, 90.0, 320.0],
        "laser_triangulation_hash": "",
        "platform_extrinsics_hash": "",
    }
    for name, plane in rig.lasers.items():
        values[f"distance_{name}"] = plane.distance_mm
        values[f"normal_{name}"] = plane.normal.tolist()
    return {"calibration_settings": {name: {"value": value} for name, value in values.items()}}


def fabscan_file(rig: Rig, *, flips: tuple[bool, bool, bool] = (True, True, False)) -> dict[str, Any]:
    """The configuration of a FabScanPi with two lasers, of which the first is the right one."""
    rotate, hflip, vflip = (str(flip) for flip in flips)
    width, height = rig.camera.size[::-1] if flips[0] else rig.camera.size
    return {
        "folders": {"scans": "scans"},
        "laser": {"interleaved": "False", "numbers": 2, "color": "R (RGB)"},
        "calibration": {
            "pattern": {"square_size": 10, "rows": 6, "columns": 8, "origin_distance": 37.2},
            "camera_matrix": rig.camera.matrix.tolist(),
            "distortion_vector": [rig.camera.distortion.tolist()],
            "laser_planes": [
                {
                    "deviation": 0.061,
                    "distance": rig.lasers[name].distance_mm,
                    "normal": rig.lasers[name].normal.tolist(),
                }
                for name in ("right", "left")
            ],
            "platform_translation": rig.axis.origin.tolist(),
            "platform_rotation": platform_rotation(rig).tolist(),
        },
        "turntable": {"steps": 3200, "radius": 70, "height": 155},
        "camera": {
            "resolution": {"width": width, "height": height},
            "rotate": rotate,
            "hflip": hflip,
            "vflip": vflip,
            "type": "PICAM",
            "undistort": str(bool(rig.camera.distortion.any())),
        },
        "keep_raw_images": "True",
    }


def their_points(rig: Rig, pixels: Pixels, laser: str, angle_deg: float, sign: float) -> Points:
    """World points by the formula of both; sign is -1 for Horus, which turns back, and +1 for FabScanPi."""
    straight = cv2.undistortPoints(
        pixels[:, None],
        rig.camera.matrix,
        rig.camera.distortion,
        P=rig.camera.matrix,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14),
    )[:, 0]
    rays = np.column_stack([straight, np.ones(len(straight))]) @ np.linalg.inv(rig.camera.matrix).T
    plane, rotation = rig.lasers[laser], platform_rotation(rig)
    in_camera = rays * (plane.distance_mm / (rays @ plane.normal))[:, None]
    c, s = np.cos(np.radians(sign * angle_deg)), np.sin(np.radians(sign * angle_deg))
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((in_camera - rig.axis.origin) @ rotation @ turned.T)


def our_points(record: CalibrationRecord, pixels: Pixels, laser: str, angle_deg: float) -> Points:
    """World points of the imported calibration, at an angle of the table as the other program counts it."""
    direction = record.extra["provenance"]["turntable_direction"]
    sign = {"ccw": 1.0, "cw": -1.0}[direction]
    return record.rig.triangulate(pixels, laser, np.radians(sign * angle_deg))


def stripe(rig: Rig) -> Pixels:
    """Pixels at which a laser may be seen, in the middle of the picture, not all of one column."""
    width, height = rig.camera.size
    rows = np.linspace(0.3 * height, 0.7 * height, 9)
    return np.column_stack([width * (0.45 + 0.1 * np.linspace(0.0, 1.0, 9) ** 2), rows])


def in_the_sensor(pixels: Pixels, size: tuple[int, int], flips: tuple[bool, bool, bool]) -> Pixels:
    """Where pixels of a program's picture lie in the picture of the sensor, whose size is given.

    Found by flipping pictures that hold the place of each pixel, not by a formula.
    """
    width, height = size
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.column_stack([_at(_flipped(of, flips), pixels) for of in (columns, rows)])


def in_the_bench(pixels: Pixels, size: tuple[int, int], rotation: int, mirror: bool) -> Pixels:
    """Where pixels of the sensor lie in a bench's picture, which is turned and then mirrored."""
    turned = {
        0: None,
        90: cv2.ROTATE_90_COUNTERCLOCKWISE,
        180: cv2.ROTATE_180,
        270: cv2.ROTATE_90_CLOCKWISE,
    }[rotation]
    width, height = size if rotation in (0, 180) else size[::-1]
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    back = [cv2.flip(of, 1) if mirror else of for of in (columns, rows)]
    back = [of if turned is None else cv2.rotate(of, turned) for of in back]
    return np.column_stack([_at(of, pixels) for of in back])


def _flipped(image: Any, flips: tuple[bool, bool, bool]) -> Any:
    rotate, hflip, vflip = flips
    image = cv2.transpose(image) if rotate else image
    image = cv2.flip(image, 1) if hflip else image
    return cv2.flip(image, 0) if vflip else image


def _at(image: Any, pixels: Pixels) -> Floats:
    """Between the pixels of an image whose values grow evenly: (N,)."""
    first = np.floor(pixels).astype(int)
    part = pixels - first
    u, v = first[:, 0], first[:, 1]
    here = image.astype(np.float64)
    return np.asarray(
        here[v, u] + part[:, 0] * (here[v, u + 1] - here[v, u]) + part[:, 1] * (here[v + 1, u] - here[v, u])
    )
