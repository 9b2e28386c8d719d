"""One cloud of several that lie on each other, less noisy than each."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.surface.joining.refine import Partners, Searched
from app.surface.joining.sample import Sample, known_sigma


def in_one_frame(clouds: Sequence[PointCloud], poses: Sequence[RigidTransform]) -> PointCloud:
    """All points of all clouds in the frame of the first.

    From where they were seen is told in their own frames and is left out, and so are the lasers' names: a
    cloud that has them stands on the table.
    """
    moved = []
    for cloud, pose in zip(clouds, poses, strict=True):
        moved.append(
            replace(
                cloud,
                points=(pose @ cloud.points.astype(np.float64)).astype(np.float32),
                normals=(cloud.normals.astype(np.float64) @ pose.rotation.T).astype(np.float32),
                angle_deg=np.zeros(len(cloud), np.float32),
                laser_names=(),
            )
        )
    return PointCloud.joined(moved)


def fuse(clouds: Sequence[PointCloud], poses: Sequence[RigidTransform], reach_mm: float) -> PointCloud:
    """As `in_one_frame`, and where clouds lie on each other each point is a mean of all of them.

    A point moves along its normal alone, to the mean of its own place and of the surfaces of the other clouds
    beside it, each counted by one over its variance. Of two points that are each other's nearest, one is
    kept, in the middle.

    Args:
        reach_mm: how far apart points of one place may be.
    """
    samples = [Sample.of(cloud) for cloud in clouds]
    searched = [Searched.of(sample) for sample in samples]
    first = np.cumsum([0] + [len(cloud) for cloud in clouds])
    whole = in_one_frame(clouds, poses)
    information: Floats = np.concatenate([1.0 / known_sigma(cloud) ** 2 for cloud in clouds])
    total = information.copy()
    shift = np.zeros((len(whole), 3))
    colours = whole.colours * information[:, None]
    nearest = np.full((len(clouds), len(whole)), -1, np.intp)
    for one in range(len(clouds)):
        for other in range(len(clouds)):
            if one == other:
                continue
            pairs = Partners.between(samples[one], poses[one], searched[other], poses[other], reach_mm)
            mine, theirs = first[one] + pairs.which, first[other] + pairs.theirs
            weight = information[theirs]
            total[mine] += weight
            shift[mine] += (weight * pairs.apart_mm)[:, None] * pairs.normals
            colours[mine] += weight[:, None] * whole.colours[theirs]
            nearest[other, mine] = theirs
    is_kept = np.ones(len(whole), np.bool_)
    for other in range(len(clouds)):
        mine = np.flatnonzero(nearest[other] >= 0)
        theirs = nearest[other, mine]
        owner = np.searchsorted(first, mine, "right") - 1
        is_mutual = (nearest[owner, theirs] == mine) & (owner > other)
        is_kept[mine[is_mutual]] = False
    is_shared = np.any(nearest >= 0, axis=0)
    is_known = np.isfinite(whole.sigma_mm)
    sigma = np.where(is_shared & is_known, 1.0 / np.sqrt(total), whole.sigma_mm)
    fused = replace(
        whole,
        points=(whole.points + shift / total[:, None]).astype(np.float32),
        colours=np.rint(colours / total[:, None]).astype(np.uint8),
        sigma_mm=sigma.astype(np.float32),
    )
    return fused.select(is_kept)
