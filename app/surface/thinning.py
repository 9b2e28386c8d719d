"""Clouds of any size, brought to one that can be worked with."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.geometry.cloud import PointCloud
from app.surface.ply_reader import PlyFile

MOST_POINTS = 6_000_000
"""What fits into the memory of a usual computer with everything that is made of it."""


@dataclass(frozen=True, eq=False, slots=True)
class Read:
    """A cloud from a file.

    Attributes:
        cloud: evenly chosen points where there are too many; some may be not finite.
        points: that the file has.
    """

    cloud: PointCloud
    points: int

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for the person where points were left out."""
        if len(self.cloud) == self.points:
            return ()
        return (f"Of {self.points:,} points an even choice of {len(self.cloud):,} is used.",)


def read_thinned(path: Path, most: int = MOST_POINTS) -> Read:
    """Every k-th point of a PLY file, as few as must be left out, read piece by piece.

    Raises:
        PointCloudFileError: it cannot be read.
    """
    file = PlyFile.open(path)
    step = max(1, -(-file.points // most))
    kept, done = [], 0
    for piece in file.pieces(allows_nowhere=True):
        which = np.arange(-done % step, len(piece), step)
        kept.append(piece if step == 1 else piece.select(which))
        done += len(piece)
    return Read(PointCloud.joined(kept), file.points)


def without_copies(cloud: PointCloud) -> PointCloud:
    """Each place once, and none that is not finite; the order stays."""
    finite = cloud.select(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
    first = np.unique(place_keys(finite.points), return_index=True)[1]
    return finite if len(first) == len(finite) else finite.select(np.sort(first))


def place_keys(points: NDArray[np.float32]) -> NDArray[np.uint64]:
    """(N,) one number for each place of (N, 3) points; two places share one hardly ever."""
    # Adding zero makes a negative zero a positive one.
    bits = np.ascontiguousarray(points + np.float32(0.0)).view(np.uint32).astype(np.uint64)
    keys: NDArray[np.uint64] = bits[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    for column in (1, 2):
        keys = (keys ^ (keys >> np.uint64(29)) ^ bits[:, column]) * np.uint64(0xBF58476D1CE4E5B9)
    return keys
