"""Which spots are the dots of a printed grid, and which dot is which.

From a spot and two of its neighbours a lattice is grown spot by spot, each step predicted from the one
before it, so that perspective and distortion may bend it. The printed pattern is then looked for in the
numbered spots.
"""

from collections.abc import Iterator
from typing import TypeAlias

import cv2
import numpy as np
from scipy.spatial import KDTree

from app.geometry.arrays import Floats, Pixels
from app.vision.board import BoardSpec
from app.vision.board_order import most_upright
from app.vision.dots import Dots

Place: TypeAlias = tuple[int, int]

_SEEDS, _NEIGHBOURS = 6, 8
_STEP_TOLERANCE, _SIZE_TOLERANCE = 0.3, 1.7
_FIT_TOLERANCE = 0.25
"""A dot may lie this share of the spacing off the homography of all; distortion bends the pattern."""


def find_grid(dots: Dots, spec: BoardSpec) -> Pixels:
    """Centres (N, 2) in the board's order; (0, 2) where the pattern is not among the spots.

    Of the numberings an ambiguous board allows, the one with its rows to the right or down.
    """
    pattern = _pattern(spec)
    if len(dots.centres) < len(pattern):
        return np.zeros((0, 2))
    tree = KDTree(dots.centres)
    for seed, first, second in _starts(dots, tree):
        places = _grown(dots, tree, seed, first, second)
        if len(places) < len(pattern):
            continue
        found = [
            grid
            for grid in _matches(places, pattern, dots.centres)
            if _is_flat(grid, spec.points()[:, :2], spec.spacing_mm)
        ]
        if found:
            return most_upright([grid.reshape(*spec.shape, 2) for grid in found]).reshape(-1, 2)
    return np.zeros((0, 2))


def _pattern(spec: BoardSpec) -> list[Place]:
    """Places of the dots on a square lattice, which lies at 45 degrees to the rows of a staggered grid."""
    steps = np.rint(spec.points()[:, :2] / spec.spacing_mm).astype(int)
    if spec.kind == "asymmetric_circles":
        x, y = steps.T
        steps = np.column_stack([(x + y) // 2, (y - x) // 2])
    return [(int(i), int(j)) for i, j in steps]


def _starts(dots: Dots, tree: KDTree) -> Iterator[tuple[int, int, int]]:
    """A spot in the thick of it and two of its neighbours, the second clockwise of the first."""
    middle = np.median(dots.centres, axis=0)
    seeds = np.argsort(np.linalg.norm(dots.centres - middle, axis=1))[:_SEEDS]
    for seed in seeds:
        nearest = np.atleast_1d(tree.query(dots.centres[seed], min(_NEIGHBOURS + 1, len(dots.centres)))[1])
        near = [int(n) for n in nearest[1:] if _is_alike(dots.sizes[seed], dots.sizes[n])]
        pairs = [(a, b) for a in near for b in near if a != b]
        rank = {n: place for place, n in enumerate(near)}
        for a, b in sorted(pairs, key=lambda pair: rank[pair[0]] + rank[pair[1]]):
            one, other = dots.centres[a] - dots.centres[seed], dots.centres[b] - dots.centres[seed]
            turn = one[0] * other[1] - one[1] * other[0]
            if turn > 0.3 * np.linalg.norm(one) * np.linalg.norm(other):
                yield int(seed), a, b


def _grown(dots: Dots, tree: KDTree, seed: int, first: int, second: int) -> dict[Place, int]:
    """Spots by their place on the lattice that the three span."""
    at = dots.centres
    places: dict[Place, int] = {(0, 0): seed}
    steps: dict[Place, Floats] = {(1, 0): at[first] - at[seed], (0, 1): at[second] - at[seed]}
    waiting: list[tuple[Place, dict[Place, Floats]]] = [((0, 0), steps)]
    taken = {seed}
    while waiting:
        place, steps = waiting.pop(0)
        here = places[place]
        measured = dict(steps)
        for (di, dj), step in steps.items():
            for sign in (1, -1):
                there = (place[0] + sign * di, place[1] + sign * dj)
                if there in places:
                    continue
                distance, spot = tree.query(at[here] + sign * step)
                if (
                    distance > _STEP_TOLERANCE * np.linalg.norm(step)
                    or int(spot) in taken
                    or not _is_alike(dots.sizes[here], dots.sizes[int(spot)])
                ):
                    continue
                places[there] = int(spot)
                taken.add(int(spot))
                measured[(di, dj)] = sign * (at[int(spot)] - at[here])
                waiting.append((there, dict(measured)))
    return places


def _matches(places: dict[Place, int], pattern: list[Place], centres: Pixels) -> Iterator[Pixels]:
    """Every way to find the whole pattern among the numbered spots by turning and shifting it."""
    for _ in range(4):
        i0, j0 = pattern[0]
        for i, j in places:
            wanted = [(a + i - i0, b + j - j0) for a, b in pattern]
            if all(place in places for place in wanted):
                yield centres[[places[place] for place in wanted]]
        pattern = [(-b, a) for a, b in pattern]


def _is_flat(grid: Pixels, board: Floats, spacing_mm: float) -> bool:
    """Whether a homography explains the dots, measured on the board."""
    homography = np.asarray(cv2.findHomography(grid, board)[0], np.float64)
    if homography.shape != (3, 3):
        return False
    back = np.asarray(cv2.perspectiveTransform(grid.reshape(-1, 1, 2), homography)).reshape(-1, 2)
    return float(np.abs(back - board).max()) < _FIT_TOLERANCE * spacing_mm


def _is_alike(one: float, other: float) -> bool:
    return max(one, other) < _SIZE_TOLERANCE * min(one, other)
