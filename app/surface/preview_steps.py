"""What a list of steps would do, on a thinned copy, quickly enough for a page."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.geometry.cloud import PointCloud
from app.surface.step import Step, document_of
from app.surface.thinning import place_keys

PREVIEW_POINTS = 150_000


@dataclass(frozen=True, slots=True)
class StepEffect:
    """What one step of a preview did.

    Attributes:
        kind: of the step.
        before, after: points of the copy.
        taken: points that the step would take from the whole cloud, reckoned from the copy.
        note: what the step had to say.
    """

    kind: str
    before: int
    after: int
    taken: int
    note: str


@dataclass(frozen=True, eq=False, slots=True)
class StepPreview:
    """A cleaned copy.

    Attributes:
        cloud: what is left of the copy.
        share: of the cloud's points that the copy began with, 0..1.
        effects: one for each step.
        gone: what steps took from the copy; without that of steps that make or move points.
    """

    cloud: PointCloud
    share: float
    effects: tuple[StepEffect, ...]
    gone: PointCloud


def preview_steps(
    cloud: PointCloud, steps: Sequence[Step], most: int = PREVIEW_POINTS, whole: int | None = None
) -> StepPreview:
    """Apply steps to an even choice of points.

    What depends on how dense the points lie is adapted; steps that make new points (`thin`) take fewer from a
    copy than from the whole.

    Args:
        most: points of the copy.
        whole: points of the cloud, where the one that is given is an even choice already.

    Raises:
        SurfaceError: a step makes no sense for this cloud.
    """
    step = max(1, -(-len(cloud) // most))
    copy = cloud.select(np.arange(0, len(cloud), step)) if step > 1 else cloud
    share = len(copy) / (whole or len(cloud)) if len(copy) else 1.0
    effects, gone = [], [PointCloud.empty(copy.laser_names)]
    for each in steps:
        fitting = each.for_share(share)
        note = fitting.says(copy)
        left = fitting.apply(copy)
        taken = round((len(copy) - len(left)) / share)
        effects.append(StepEffect(document_of(each)["kind"], len(copy), len(left), taken, note))
        gone.append(_taken(copy, left))
        copy = left
    return StepPreview(copy, share, tuple(effects), PointCloud.joined(gone))


def _taken(before: PointCloud, after: PointCloud) -> PointCloud:
    """The points that a step left out; none where it moved them, so that nobody can tell which those are."""
    is_left = np.isin(place_keys(before.points), place_keys(after.points))
    if np.count_nonzero(is_left) < len(after):
        return PointCloud.empty(before.laser_names)
    return before.select(~is_left)
