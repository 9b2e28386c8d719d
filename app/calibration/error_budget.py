"""What the uncertainty of a calibration does to a surface point at the object."""

import numpy as np

from app.calibration.bundle import Columns, moved
from app.calibration.projection import camera_from_vector
from app.calibration.solver import Solution
from app.geometry.arrays import Floats, Pixels, Points
from app.geometry.axis import TurntableAxis
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig

OBJECT_RADIUS_MM = 50.0
_HEIGHTS = 15


def object_pixels(rig: Rig, laser: str, radius_mm: float = OBJECT_RADIUS_MM) -> Pixels:
    """Where the laser's stripe on a cylinder about the axis is seen: (N, 2) px, inside the picture.

    The cylinder is as high as it is wide, about the axis point nearest the middle of the picture.
    """
    plane, axis = rig.lasers[laser], rig.axis
    d = axis.direction
    # The axis point nearest the optical axis z.
    across = np.array([d[0], d[1], 0.0])
    middle = axis.point_mm - d * float(axis.point_mm @ across) / max(float(across @ across), 1e-12)
    along_line = np.cross(d, plane.normal)
    lean = np.linalg.norm(along_line)
    if lean < 1e-6:
        return np.zeros((0, 2))
    along_line /= lean
    points = []
    for height in np.linspace(-radius_mm, radius_mm, _HEIGHTS):
        centre = middle + height * d
        flat = plane.normal - (plane.normal @ d) * d
        foot = centre + flat * (plane.distance_mm - plane.normal @ centre) / float(flat @ flat)
        reach = radius_mm**2 - float(np.sum((foot - centre) ** 2))
        if reach <= 0.0:
            continue
        both = [foot + sign * np.sqrt(reach) * along_line for sign in (1.0, -1.0)]
        points.append(min(both, key=np.linalg.norm))
    if not points:
        return np.zeros((0, 2))
    pixels = rig.camera.project(np.array(points))
    width, height_px = rig.camera.size
    inside = np.all((pixels >= 0.0) & (pixels <= [width - 1.0, height_px - 1.0]), axis=1)
    return pixels[inside]


def expected_error_mm(rig: Rig, solution: Solution, n_lasers: int) -> float:
    """One sigma, across the surface, of points on a cylinder of 50 mm about the axis.

    Only what calibration causes: camera, laser planes and axis, with their covariance; not the noise of
    the stripe. NaN where no laser crosses that cylinder in the picture.
    """
    at = Columns.of(solution.state)
    columns = np.concatenate([np.arange(13), np.arange(at.planes, at.planes + 3 * n_lasers)])
    covariance = solution.covariance_of(columns)
    variances: list[Floats] = []
    for row, laser in enumerate(rig.lasers):
        pixels = object_pixels(rig, laser)
        if len(pixels) == 0:
            continue
        here = _points(solution, row, pixels, np.zeros(at.total))
        radial = here.copy()
        radial[:, 2] = 0.0
        radial /= np.linalg.norm(radial, axis=1)[:, None]
        jacobian = np.zeros((len(pixels), len(columns)))
        for k, column in enumerate(columns):
            sigma = np.sqrt(covariance[k, k])
            if sigma > 0.0:
                delta = np.zeros(at.total)
                delta[column] = sigma
                ahead = _points(solution, row, pixels, delta)
                behind = _points(solution, row, pixels, -delta)
                jacobian[:, k] = np.sum((ahead - behind) * radial, axis=1) / (2.0 * sigma)
        variances.append(np.einsum("nk,kl,nl->n", jacobian, covariance, jacobian))
    if not variances:
        return float("nan")
    return float(np.sqrt(np.mean(np.concatenate(variances))))


def _points(solution: Solution, laser: int, pixels: Pixels, delta: Floats) -> Points:
    state = moved(solution.state, delta)
    plane = state.planes[laser]
    rays = camera_from_vector(state.camera, state.size).rays(pixels)
    hits = LaserPlane(plane[:3], float(plane[3])).intersect_rays(rays)
    axis = TurntableAxis(state.axis_point, state.axis_direction)
    points: Points = axis.camera_from_table.inverse() @ hits
    return points
