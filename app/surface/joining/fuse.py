"""One cloud of several that lie on each other, less noisy than each."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.surface.joining.refine import Partners, Searched, spread
from app.surface.joining.sample import Sample

# Beyond so many times what is usual, points are not two of one place.
_NOISES, _SPACINGS = 4.0, 3.0


def in_one_frame(clouds: Sequence[PointCloud], poses: Sequence[RigidTransform]) -> PointCloud:
    """All points of all clouds in the frame of the first.

    From where they were seen is told in their own frames and is left out, and so are the lasers: a cloud that
    names them stands on the table, and their errors lie in the frame of each scan.
    """
    moved = []
    for cloud, pose in zip(clouds, poses, strict=True):
        moved.append(
            replace(
                cloud,
                points=(pose @ cloud.points.astype(np.float64)).astype(np.float32),
                normals=(cloud.normals.astype(np.float64) @ pose.rotation.T).astype(np.float32),
                angle_deg=np.zeros_like(cloud.angle_deg),
                laser=np.zeros_like(cloud.laser),
                laser_names=(),
            )
        )
    return PointCloud.joined(moved)


def fuse(clouds: Sequence[PointCloud], poses: Sequence[RigidTransform], reach_mm: float) -> PointCloud:
    """As `in_one_frame`, and where clouds lie on each other each point is a mean of all of them.

    A point moves along its normal alone, to the mean of its own place and of the surfaces of the other clouds
    beside it, each counted by one over its variance. Colours and normals are mixed alike. Of two points
    that are each other's nearest, one is kept. Points that are farther apart than their noise explains stay
    where they are.

    Args:
        reach_mm: how far apart points of one place may be at most.
    """
    samples = [Sample.of(cloud) for cloud in clouds]
    searched = [Searched.of(sample) for sample in samples]
    first = np.cumsum([0] + [len(cloud) for cloud in clouds])
    whole = in_one_frame(clouds, poses)
    information = np.concatenate([1.0 / sample.sigma_mm**2 for sample in samples])
    total = information.copy()
    shift = np.zeros((len(whole), 3))
    colours = whole.colours * information[:, None]
    normals = whole.normals * information[:, None]
    nearest = np.full((len(clouds), len(whole)), -1, np.int32)
    for one, other in permutations(range(len(clouds)), 2):
        pairs = _beside(Partners.between(samples[one], poses[one], searched[other], poses[other], reach_mm))
        mine, theirs = first[one] + pairs.which, first[other] + pairs.theirs
        weight = information[theirs]
        total[mine] += weight
        shift[mine] += (weight * pairs.apart_mm)[:, None] * pairs.normals
        colours[mine] += weight[:, None] * whole.colours[theirs]
        normals[mine] += weight[:, None] * whole.normals[theirs]
        nearest[other, mine] = theirs
    is_known = np.any(nearest >= 0, axis=0) & np.isfinite(whole.sigma_mm)
    fused = replace(
        whole,
        points=(whole.points + shift / total[:, None]).astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        colours=np.rint(colours / total[:, None]).astype(np.uint8),
        sigma_mm=np.where(is_known, 1.0 / np.sqrt(total), whole.sigma_mm).astype(np.float32),
    )
    return fused.select(~_is_second(nearest, first))


def _beside(pairs: Partners) -> Partners:
    """Those that lie close to each other as points of two scans of one surface do."""
    if not len(pairs):
        return pairs
    usual = np.maximum(spread(pairs.apart_mm), 1.0 / np.sqrt(pairs.weights))
    return pairs.select(
        (np.abs(pairs.apart_mm) <= _NOISES * usual)
        & (pairs.distances_mm <= _SPACINGS * float(np.median(pairs.distances_mm)))
    )


def _is_second(nearest: NDArray[np.int32], first: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(N,) which points have one in an earlier cloud, and are the one nearest to it in their own.

    Args:
        nearest: (K, N) for each cloud, the number of its point beside each point, or -1.
        first: (K + 1,) number of each cloud's first point.
    """
    is_second = np.zeros(nearest.shape[1], np.bool_)
    for other in range(len(nearest)):
        later = np.arange(first[other + 1], nearest.shape[1])
        mine = later[nearest[other, later] >= 0]
        owner = np.searchsorted(first, mine, "right") - 1
        is_second[mine] |= nearest[owner, nearest[other, mine]] == mine
    return is_second
