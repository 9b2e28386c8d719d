"""Take noise away along the normals, and leave edges where they are."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.surface.neighbours import Places, is_finite
from app.surface.normals import with_normals
from app.surface.step import STEPS, Step

_NEIGHBOURS = 16
_MAD_TO_SIGMA = 1.4826
_STEEPEST = 2.5
_AGREEMENT_DEG = 25.0


class Smooth(Step):
    """Moves each point along its normal towards its neighbours' surface (a bilateral filter).

    A neighbour counts the less the further away it lies, the more its normal differs and the further it is
    from the point's tangent plane in units of the noise: what lies across an edge or a step hardly counts.
    Heights are taken along the mean of both normals, so that round surfaces do not shrink. Points without
    neighbours of their kind stay; points that are not finite go.

    Attributes:
        rounds: how often; each takes away some of the noise that the one before left.
        noise_mm: how much of a height is noise; estimated from the cloud where absent.
        neighbours: how many of the nearest points count.
    """

    rounds: Annotated[int, Field(ge=1, le=20, title="Rounds", description="How often: more is smoother.")] = 2
    noise_mm: Annotated[
        float | None,
        Field(
            gt=0.0, le=10.0, title="Noise, mm",
            description="Steps much larger than this stay, mm; estimated from the cloud where absent.",
        ),
    ] = None  # fmt: skip
    neighbours: Annotated[
        int, Field(ge=4, le=100, title="Neighbours", description="How many of the nearest points count.")
    ] = _NEIGHBOURS

    def apply(self, cloud: PointCloud) -> PointCloud:
        cloud = with_normals(cloud.select(is_finite(cloud.points)))
        places = Places.of(cloud.points)
        count = min(self.neighbours + 1, len(places))
        if count < 4:
            return cloud
        normals = cloud.normals[places.first].astype(np.float64)
        heights = np.zeros(len(places))
        numbers = np.empty((len(places), count - 1), np.int32)
        distances = np.empty((len(places), count - 1), np.float32)
        for part, found, which in places.nearest(count):
            numbers[part], distances[part] = which[:, 1:], found[:, 1:]
        reach = float(np.median(distances[:, -1])) / 2.0
        noise = self.noise_mm
        for _ in range(self.rounds):
            moved = places.points + heights[:, None] * normals
            if noise is None:
                noise = _noise(moved, normals, numbers)
            heights += _step(moved, normals, numbers, distances, reach, max(noise, 1e-6))
        points = cloud.points + heights[places.of_point, None] * cloud.normals
        return replace(cloud, points=points.astype(np.float32))


def _step(
    points: Floats, normals: Floats, numbers: NDArray[np.int32], distances: NDArray[np.float32], reach: float,
    noise: float,
) -> Floats:  # fmt: skip
    """(M,) how far each point should go along its normal, mm."""
    # A point's own height, zero, counts once.
    total, weights = np.zeros(len(points)), np.ones(len(points))
    widest = 1.0 - np.cos(np.radians(_AGREEMENT_DEG))
    for near, away in zip(numbers.T, distances.T, strict=True):
        height, agree = _height(points, normals, near)
        weight = np.exp(
            -0.5 * (away / reach) ** 2
            - 0.5 * (height / (_STEEPEST * noise)) ** 2
            - np.maximum(1.0 - agree, 0.0) / widest
        )
        total += weight * height
        weights += weight
    moves: Floats = total / weights
    return moves


def _height(points: Floats, normals: Floats, near: NDArray[np.int32]) -> tuple[Floats, Floats]:
    """(M,) how far above a point its neighbour lies, mm, and the cosine between their normals."""
    other = normals[near]
    apart = points[near] - points
    agree = np.einsum("ij,ij->i", normals, other)
    return np.einsum("ij,ij->i", apart, (normals + other) / 2.0), agree


def _noise(points: Floats, normals: Floats, numbers: NDArray[np.int32]) -> float:
    """The usual height of a nearest neighbour above a point, as the standard deviation of one of them, mm."""
    height, agree = _height(points, normals, numbers[:, 0])
    level = np.abs(height[agree > np.cos(np.radians(_AGREEMENT_DEG))])
    return _MAD_TO_SIGMA * float(np.median(level)) / np.sqrt(2.0) if len(level) else 0.0


STEPS.register("smooth", Smooth)
