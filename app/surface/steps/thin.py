"""Make one point of all that lie in one small cell."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.surface.neighbours import cell_keys, is_finite
from app.surface.step import STEPS, Step

_LEAST_OF_USUAL = 0.2


class Thin(Step):
    """One point for each cell: the mean of those in it, each counted by how sure it is.

    The weight is one over the variance; the mean's own sigma is what the points' noise leaves after
    averaging. What is common to all of them, such as an error of the calibration, stays. Laser and angle
    are those of the surest point. Points that are not finite go.

    Attributes:
        size_mm: edge of a cell.
    """

    size_mm: Annotated[
        float,
        Field(gt=0.0, le=1000.0, title="Cell, mm", description="Edge of a cell, mm: about the new spacing."),
    ] = 0.5

    def apply(self, cloud: PointCloud) -> PointCloud:
        cloud = cloud.select(is_finite(cloud.points))
        if not len(cloud):
            return cloud
        keys = cell_keys(cloud.points, self.size_mm)
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        del keys
        cloud = cloud.select(order)
        weights = _weights(cloud.sigma_mm)
        total = np.add.reduceat(weights, starts)

        def mean(values: NDArray[np.generic]) -> Floats:
            columns = values.reshape(len(values), -1).astype(np.float64).T
            means = [np.add.reduceat(weights * column, starts) / total for column in columns]
            return np.stack(means, axis=1)

        normals = mean(cloud.normals)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        # Two sides of a thin wall in one cell cancel each other: no normal rather than a wrong one.
        normals = np.where(lengths > 0.1, normals / np.maximum(lengths, 1e-12), 0.0)
        surest = _first_of_greatest(weights, starts)
        return PointCloud(
            mean(cloud.points).astype(np.float32), normals.astype(np.float32),
            np.rint(mean(cloud.colours)).astype(np.uint8), _sigma_of_mean(cloud.sigma_mm, starts),
            cloud.laser[surest], cloud.angle_deg[surest], mean(cloud.quality)[:, 0].astype(np.float32),
            cloud.laser_names,
        )  # fmt: skip


def _weights(sigma_mm: NDArray[np.float32]) -> Floats:
    """(N,) one over the variance, as a multiple of the usual; one where nothing is known."""
    sigma = sigma_mm.astype(np.float64)
    is_known = np.isfinite(sigma) & (sigma > 0.0)
    if not is_known.any():
        return np.ones(len(sigma))
    usual = float(np.median(sigma[is_known]))
    # Nobody is so sure that all others count for nothing.
    relative = np.maximum(np.where(is_known, sigma / usual, 1.0), _LEAST_OF_USUAL)
    weights: Floats = 1.0 / relative**2
    return weights


def _sigma_of_mean(sigma_mm: NDArray[np.float32], starts: NDArray[np.intp]) -> NDArray[np.float32]:
    """(C,) what noise is left in each cell's mean, mm; NaN where nothing is known of any of its points."""
    with np.errstate(divide="ignore"):
        information = np.where(np.isfinite(sigma_mm), 1.0 / sigma_mm.astype(np.float64) ** 2, 0.0)
    with np.errstate(divide="ignore"):
        sigma = 1.0 / np.sqrt(np.add.reduceat(information, starts))
    return np.where(np.isfinite(sigma), sigma, np.nan).astype(np.float32)


def _first_of_greatest(weights: Floats, starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """(C,) for each run of points that begins at `starts`, where its greatest weight stands."""
    run = np.zeros(len(weights), np.intp)
    run[starts[1:]] = 1
    run = np.cumsum(run)
    is_greatest = np.flatnonzero(weights == np.maximum.reduceat(weights, starts)[run])
    first = np.full(len(starts), len(weights), np.intp)
    np.minimum.at(first, run[is_greatest], is_greatest)
    return first


STEPS.register("thin", Thin)
