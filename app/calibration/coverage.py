"""Where in the picture the corners were, and what the views therefore cannot tell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform

_CELLS = 8
_ENOUGH_VIEWS = 8
_ENOUGH_COVERAGE = 0.5
_ENOUGH_TILT_DEG = 15.0
_ENOUGH_DISTANCES = 1.15
_GOOD_FOCAL_ERROR = 0.01
_NOISE_PX = 0.1


@dataclass(frozen=True, eq=False, slots=True)
class Coverage:
    """How the corners of all views lie in the picture.

    Attributes:
        counts: (rows, columns) corners in each cell of a grid over the picture.
        share: part of the cells that hold a corner, 0..1.
    """

    counts: NDArray[np.intp]
    share: float

    @classmethod
    def of(cls, corners: Sequence[Pixels], size: tuple[int, int]) -> "Coverage":
        """Corners of all views in a picture of that width and height; the cells are nearly square."""
        width, height = size
        longest = max(width, height)
        bins = (max(2, round(_CELLS * height / longest)), max(2, round(_CELLS * width / longest)))
        places = np.vstack([np.zeros((0, 2)), *corners])
        limits = [(-0.5, height - 0.5), (-0.5, width - 0.5)]
        counted = np.histogram2d(places[:, 1], places[:, 0], bins=bins, range=limits)[0]
        return cls(counted.astype(np.intp), float(np.mean(counted > 0)))


def tilt_spread_deg(poses: Sequence[RigidTransform]) -> float:
    """Largest angle between the planes of two boards, 0 to 90."""
    normals = np.array([pose.rotation[:, 2] for pose in poses]).reshape(-1, 3)
    cosines = np.abs(normals @ normals.T)
    return float(np.degrees(np.arccos(np.clip(cosines.min(initial=1.0), 0.0, 1.0))))


def focal_error(camera: CameraIntrinsics, deviations: Floats, rms_px: float) -> float:
    """Relative standard deviation of the focal length, for corners no better than a tenth of a pixel.

    Args:
        camera: the solution.
        deviations: its standard deviations, fx and fy first, px.
        rms_px: the residual they were computed from.
    """
    focal = np.array([camera.matrix[0, 0], camera.matrix[1, 1]])
    scale = max(1.0, _NOISE_PX / rms_px) if rms_px > 0.0 else np.inf
    return float(np.max(deviations[:2] / focal)) * scale


def doubts(
    camera: CameraIntrinsics,
    poses: Sequence[RigidTransform],
    distances_mm: Sequence[float],
    coverage: Coverage,
    relative_focal_error: float,
) -> tuple[str, ...]:
    """What a person should know before trusting the camera, however small its residuals. Plain sentences.

    Args:
        camera: the solution.
        poses: where each board stood.
        distances_mm: how far from the camera the middle of each board was.
        coverage: of all corners.
        relative_focal_error: see `focal_error`.
    """
    said: list[str] = []
    if len(poses) < _ENOUGH_VIEWS:
        said.append(
            f"Only {len(poses)} views of the board were used; take {_ENOUGH_VIEWS} or more, 20 are good."
        )
    spread = tilt_spread_deg(poses)
    if spread < _ENOUGH_TILT_DEG:
        said.append(
            f"All boards are nearly parallel (within {spread:.0f} degrees), "
            "so the focal length is not determined; "
            "tilt the board by 20 to 45 degrees, a different way in each view."
        )
    if not relative_focal_error <= _GOOD_FOCAL_ERROR:
        said.append(
            f"The focal length is uncertain by {100.0 * min(relative_focal_error, 1.0):.1f} %; "
            "add views in which the board is strongly tilted and close to the camera."
        )
    if coverage.share < _ENOUGH_COVERAGE:
        said.append(
            f"The corners cover only {100.0 * coverage.share:.0f} % of the picture, "
            "so the distortion elsewhere is a guess; bring the board to every side and corner of the picture."
        )
    if max(distances_mm) < _ENOUGH_DISTANCES * min(distances_mm):
        said.append("All boards are at the same distance; take some closer and some further away.")
    return (*said, *_odd_values(camera))


def _odd_values(camera: CameraIntrinsics) -> list[str]:
    said: list[str] = []
    width, height = camera.size
    cx, cy = camera.matrix[0, 2], camera.matrix[1, 2]
    if not (0.25 * width < cx < 0.75 * width and 0.25 * height < cy < 0.75 * height):
        said.append(
            f"The optical axis came out at ({cx:.0f}, {cy:.0f}), far from the middle of the picture, "
            "which few cameras do; add views that are tilted and spread over the picture."
        )
    corners = np.array([[0.0, 0.0], [width - 1, 0.0], [0.0, height - 1], [width - 1, height - 1]])
    back = camera.project(camera.rays(corners))
    if not np.all(np.abs(back - corners) < 0.01):
        said.append(
            "The distortion folds over before it reaches the corners of the picture; "
            "bring the board into the corners, or use the paper's model, which leaves out k3."
        )
    return said
