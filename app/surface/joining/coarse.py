"""How two scans lie to each other, without any idea beforehand."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Points
from app.geometry.transform import RigidTransform
from app.surface.joining.field import Field
from app.surface.joining.oriented_pairs import guesses
from app.surface.joining.refine import Partners, Searched, refine
from app.surface.joining.sample import Sample

_COARSE_POINTS, _FINE_POINTS = 1_500, 6_000
_ROUNDS, _GUESSES, _PROMISING, _DISTINCT, _FINALISTS = 3, 10_000, 1_000, 150, 6
_QUICK_POINTS, _THOROUGH_POINTS = 60, 400
_SETTLING = 15
# Of a thinned surface of small curves, and of good scans; wrong fits are several times as far apart.
_TOLERANCE = 0.05
MOST_CARVED = 0.02
CONVINCING = 0.3
"""Of two things that are not the same, the score is below zero; of halves that share nothing, up to 0.15."""
# What is so much worse than the best at first sight is not looked at again.
_HOPELESS = 0.6
_AT_ONCE = 1_000_000
_SAME_TURN_DEG, _SAME_SHIFT = 8.0, 3.0
# Points in seen-through space count so many times as much as points on the surface.
_CARVED_COUNTS = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """A way in which two scans may lie to each other.

    Attributes:
        pose: the fixed scan's frame from the moving one's.
        overlap: share of points that lie on the other scan, 0..1; of the scan that shares more.
        residual_mm: how far apart they are there.
        carved: share of points, of either scan, where the other one saw through.
        score: the overlap, counting points by how near they lie, less what is carved; the higher the better.
    """

    pose: RigidTransform
    overlap: float
    residual_mm: float
    carved: float
    score: float

    @property
    def convinces(self) -> bool:
        return self.score > CONVINCING and self.carved < MOST_CARVED


@dataclass(frozen=True, eq=False, slots=True)
class Scales:
    """A scan at the scales at which it is looked at, and the edges of their cells."""

    extent_mm: float
    coarse: Sample
    coarse_cell_mm: float
    fine: Searched
    fine_cell_mm: float
    field: Field

    @classmethod
    def of(cls, sample: Sample) -> Self:
        extent = sample.extent_mm()
        coarse, coarse_cell = sample.about(_COARSE_POINTS)
        fine, fine_cell = sample.about(_FINE_POINTS)
        field = Field.around(fine, coarse_cell / 2.0, 0.25 * extent)
        return cls(extent, coarse, coarse_cell, Searched.of(fine), fine_cell, field)


def candidates(fixed: Scales, moving: Scales, seed: int = 0) -> list[Candidate]:
    """The most likely ways, best first; few, distinct, and refined. Looks longer where none convinces."""
    rng = np.random.default_rng(seed)
    found: list[Candidate] = []
    for _ in range(_ROUNDS):
        found = _distinct_candidates(found + _round(fixed, moving, rng), fixed, moving)
        if found and found[0].convinces:
            break
    return found


def _round(fixed: Scales, moving: Scales, rng: np.random.Generator) -> list[Candidate]:
    """Guesses, the best of them settled, and the best of those refined and judged."""
    extent, cell = min(fixed.extent_mm, moving.extent_mm), _cell(fixed, moving)
    rotations, translations = guesses(fixed.coarse, moving.coarse, extent, _GUESSES, rng)
    if not len(rotations):
        return []
    quick, part = (
        moving.coarse.select(rng.permutation(len(moving.coarse))[:count])
        for count in (_QUICK_POINTS, _THOROUGH_POINTS)
    )
    middle = moving.coarse.points.mean(axis=0)
    score = _scores(fixed.field, quick, rotations, translations, 1.5 * cell)
    keep = np.argsort(-score, kind="stable")[:_PROMISING]
    rotations, translations = rotations[keep], translations[keep]
    score = _scores(fixed.field, part, rotations, translations, 1.5 * cell)
    order = np.argsort(-score, kind="stable")
    keep = _distinct(rotations, translations, middle, order, _SAME_SHIFT * cell, _DISTINCT)
    rotations, translations = rotations[keep], translations[keep]
    for reach in (3.0 * cell, 1.5 * cell):
        rotations, translations = _settled(fixed.field, part, rotations, translations, reach)
    score = _scores(fixed.field, part, rotations, translations, 0.7 * cell)
    order = np.argsort(-score, kind="stable")
    keep = _distinct(rotations, translations, middle, order, _SAME_SHIFT * cell, _FINALISTS)
    keep = keep[score[keep] > _HOPELESS * score[keep[0]]]
    return [_refined(fixed, moving, RigidTransform(rotations[n], translations[n])) for n in keep]


def _refined(fixed: Scales, moving: Scales, pose: RigidTransform) -> Candidate:
    poses = [RigidTransform.identity(), pose]
    cell = _cell(fixed, moving)
    for reach_mm, iterations in ((cell, 8), (0.4 * cell, 8)):
        poses = refine([fixed.fine, moving.fine], poses, [(0, 1)], reach_mm, iterations)
    return judged(fixed, moving, poses[1])


def _distinct_candidates(found: list[Candidate], fixed: Scales, moving: Scales) -> list[Candidate]:
    """Best first; refining brings some to the same place."""
    if not found:
        return []
    found = sorted(found, key=lambda each: -each.score)
    rotations = np.stack([each.pose.rotation for each in found])
    translations = np.stack([each.pose.translation for each in found])
    middle = moving.coarse.points.mean(axis=0)
    shift_mm = _SAME_SHIFT * _cell(fixed, moving)
    order = np.arange(len(found))
    keep = _distinct(rotations, translations, middle, order, shift_mm, _FINALISTS)
    return [found[number] for number in keep]


def _cell(fixed: Scales, moving: Scales) -> float:
    return max(fixed.coarse_cell_mm, moving.coarse_cell_mm)


def judged(fixed: Scales, moving: Scales, pose: RigidTransform) -> Candidate:
    """What speaks for a pose and against it."""
    reach = 2.0 * max(fixed.fine_cell_mm, moving.fine_cell_mm)
    here, there = RigidTransform.identity(), pose
    ways = (
        Partners.between(moving.fine.sample, there, fixed.fine, here, reach),
        Partners.between(fixed.fine.sample, here, moving.fine, there, reach),
    )
    apart = np.concatenate([way.apart_mm for way in ways])
    sizes = len(moving.fine.sample), len(fixed.fine.sample)
    residual = float(np.sqrt(np.mean(np.minimum(np.abs(apart), reach) ** 2))) if len(apart) else reach
    overlap = max(len(way) / size for way, size in zip(ways, sizes, strict=True))
    carved = max(_carved(fixed, moving, pose), _carved(moving, fixed, pose.inverse()))
    tolerance = _TOLERANCE * reach
    tight = max(
        float(np.sum(1.0 / (1.0 + (way.apart_mm / tolerance) ** 2))) / size
        for way, size in zip(ways, sizes, strict=True)
    )
    return Candidate(pose, overlap, residual, carved, tight - _CARVED_COUNTS * carved)


def _carved(fixed: Scales, moving: Scales, pose: RigidTransform) -> float:
    _, is_carved = fixed.field.near(pose @ moving.coarse.points)
    return float(np.mean(is_carved))


def _scores(field: Field, part: Sample, rotations: Floats, translations: Points, reach_mm: float) -> Floats:
    found = []
    step = max(1, _AT_ONCE // len(part))
    for start in range(0, len(rotations), step):
        turn, shift = rotations[start : start + step], translations[start : start + step]
        points = np.einsum("hij,mj->hmi", turn, part.points) + shift[:, None]
        normals = np.einsum("hij,mj->hmi", turn, part.normals)
        on, carved = field.agreement(points, normals, reach_mm)
        found.append(on - _CARVED_COUNTS * carved)
    return np.concatenate(found)


def _settled(
    field: Field, part: Sample, rotations: Floats, translations: Points, reach_mm: float
) -> tuple[Floats, Points]:
    """All poses at once a few steps nearer to where the surfaces agree, point to plane."""
    middle = field.sample.points.mean(axis=0)
    size = float(np.std(field.sample.points))
    for _ in range(_SETTLING):
        points = np.einsum("hij,mj->hmi", rotations, part.points) + translations[:, None]
        normals = np.einsum("hij,mj->hmi", rotations, part.normals)
        number, _ = field.near(points)
        partner, facing = field.sample.points[number], field.sample.normals[number]
        apart = partner - points
        away = np.einsum("hmi,hmi->hm", apart, apart) / reach_mm**2
        alike = np.einsum("hmi,hmi->hm", normals, facing)
        weights = np.where((number >= 0) & (alike > 0.6), np.clip(1.0 - away, 0.0, 1.0), 0.0)
        rows = np.concatenate([np.cross((points - middle) / size, facing), facing], axis=2)
        weighted = rows * weights[..., None]
        matrix = np.swapaxes(weighted, 1, 2) @ rows
        right = np.einsum("hmi,hm->hi", weighted, np.einsum("hmi,hmi->hm", apart, facing))
        matrix += (1e-3 * np.trace(matrix, axis1=1, axis2=2) + 1e-9)[:, None, None] * np.eye(6)
        steps = np.linalg.solve(matrix, right[..., None])[..., 0]
        turns = _rotations(steps[:, :3] / size)
        rotations = turns @ rotations
        translations = np.einsum("hij,hj->hi", turns, translations - middle) + middle + steps[:, 3:]
    return rotations, translations


def _rotations(rvecs: Floats) -> Floats:
    """(H, 3, 3) of small rotation vectors (H, 3)."""
    angle = np.linalg.norm(rvecs, axis=1)
    k = np.zeros((len(rvecs), 3, 3))
    x, y, z = (rvecs / np.maximum(angle, 1e-12)[:, None]).T
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 0] = -z, y, z
    k[:, 1, 2], k[:, 2, 0], k[:, 2, 1] = -x, -y, x
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    turns: Floats = np.eye(3) + sine * k + versine * (k @ k)
    return turns


def _distinct(
    rotations: Floats,
    translations: Points,
    middle: Floats,
    order: NDArray[np.intp],
    shift_mm: float,
    most: int,
) -> NDArray[np.intp]:
    """Numbers of the first so many in order that differ from all before."""
    places = np.einsum("hij,j->hi", rotations, middle) + translations
    least_trace = 1.0 + 2.0 * np.cos(np.radians(_SAME_TURN_DEG))
    kept: list[int] = []
    for number in order:
        traces = np.einsum("kij,ij->k", rotations[kept], rotations[number])
        is_same = (traces > least_trace) & (np.linalg.norm(places[kept] - places[number], axis=1) < shift_mm)
        if not is_same.any():
            kept.append(int(number))
            if len(kept) == most:
                break
    return np.array(kept, np.intp)
