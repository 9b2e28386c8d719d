"""Several scans of one thing, laid on each other and made one cloud."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from app.errors import SurfaceError
from app.geometry.arrays import Floats
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.surface.joining.clicked import clicked_pose
from app.surface.joining.coarse import CONVINCING, MOST_CARVED, Candidate, Scales, candidates
from app.surface.joining.fuse import fuse, in_one_frame
from app.surface.joining.options import JoinOptions, PairedPlaces
from app.surface.joining.refine import Partners, Searched, refine, spread
from app.surface.joining.sample import Sample, usable

Progress = Callable[[str, float], None]
"""Told what is being done, and how much of all is done, 0..1; may raise to stop it."""

_FINE_POINTS = 40_000
_REACH_CELLS = (6.0, 3.0, 2.0)
_ITERATIONS = 15
_LEAST_OVERLAP = 0.04
_LEAST_SCORE = 0.2
_RIVAL = 0.9


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """Where a scan lies.

    Attributes:
        pose: the frame of the first scan from that of this one.
        residual_mm: how far its surface is from the others', a robust RMS along the normals.
        overlap: share of its points that lie on another scan, 0..1.
        is_sure: whether nothing speaks against it.
    """

    pose: RigidTransform
    residual_mm: float
    overlap: float
    is_sure: bool


@dataclass(frozen=True, eq=False, slots=True)
class Joined:
    """Several scans as one.

    Attributes:
        cloud: in the frame of the first scan, without the table. It has no lasers' names and no table angles.
        placements: one for each scan.
        residual_mm: over all scans.
        notes: sentences that a person should read.
        doubts: why it must not be trusted; empty where it may.
    """

    cloud: PointCloud
    placements: tuple[Placement, ...]
    residual_mm: float
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def join(
    clouds: Sequence[PointCloud],
    options: JoinOptions | None = None,
    progress: Progress | None = None,
    names: Sequence[str] = (),
) -> Joined:
    """Lay scans on each other, whichever way the thing stood, and make one cloud of them.

    Args:
        clouds: raw, each in the frame of its own table.
        options: all usual where absent.
        progress: told how far it is.
        names: what people know the clouds by, for messages; `Scan 1` and so on where there are none.

    Raises:
        SurfaceError: a scan has too few points, or shows nothing that the others show.
    """
    options = options or JoinOptions()
    tell = progress or (lambda words, share: None)
    if not clouds:
        raise SurfaceError("There is no scan to join.", "Name two scans or more.")
    _refuse_strange_pairs(options.pairs, len(clouds))
    tell("looking at the scans", 0.0)
    names = names or [f"Scan {number + 1}" for number in range(len(clouds))]
    things = [usable(cloud, name) for cloud, name in zip(clouds, names, strict=True)]
    samples = [Sample.of(thing) for thing in things]
    poses, doubts = _placed(samples, names, options.pairs, tell)
    tell("aligning finely", 0.6)
    fine, cell = _fine(samples, options.cell_mm)
    links = _links(fine, poses, _REACH_CELLS[0] * cell)
    for cells in _REACH_CELLS:
        poses = refine(fine, poses, links, cells * cell, _ITERATIONS)
    found = _placements(fine, poses, doubts, _REACH_CELLS[-1] * cell)
    tell("making one cloud", 0.85)
    reach = _REACH_CELLS[-1] * cell
    cloud = fuse(things, poses, reach) if options.is_fused else in_one_frame(things, poses)
    placements = tuple(placement for placement, _ in found)
    apart = [residuals for _, residuals in found if len(residuals)]
    tell("done", 1.0)
    return Joined(
        cloud, placements, spread(np.concatenate(apart)) if apart else 0.0,
        _notes(clouds, things), tuple(sentence for each in doubts for sentence in each),
    )  # fmt: skip


def _refuse_strange_pairs(pairs: Sequence[PairedPlaces], count: int) -> None:
    for pair in pairs:
        if pair.cloud >= count:
            raise SurfaceError(
                f"A pair of places names scan number {pair.cloud}; the last one has number {count - 1}.",
                "The first scan has number 0.",
            )


def _placed(
    samples: Sequence[Sample], names: Sequence[str], pairs: Sequence[PairedPlaces], tell: Progress
) -> tuple[list[RigidTransform], list[tuple[str, ...]]]:
    """Roughly where each scan lies in the first one's frame, and what is doubtful about it.

    From the first scan on, the scan that lies on a placed one best is placed next.
    """
    clicked = {
        number: [pair for pair in pairs if pair.cloud == number]
        for number in sorted({pair.cloud for pair in pairs})
    }
    sizes = [Scales.of(sample) for sample in samples]
    poses: dict[int, RigidTransform] = {0: RigidTransform.identity()}
    doubts: dict[int, tuple[str, ...]] = {0: ()}
    for number, places in clicked.items():
        poses[number], doubts[number] = clicked_pose(places, names[number]), ()
    found: dict[tuple[int, int], list[Candidate]] = {}
    while len(poses) < len(samples):
        waiting = [number for number in range(len(samples)) if number not in poses]
        for number in waiting:
            for base in poses:
                if (base, number) not in found:
                    tell(
                        f"looking how scan {number + 1} lies to scan {base + 1}",
                        0.6 * len(poses) / len(samples),
                    )
                    found[base, number] = candidates(sizes[base], sizes[number])
        open_links = [link for link in found if link[1] in waiting and found[link]]
        best = max(open_links, key=lambda link: found[link][0].score, default=None)
        if best is None or found[best][0].score < _LEAST_SCORE:
            raise SurfaceError(
                f"{names[waiting[0]]} shows no surface that the others show, too.",
                "Show three places that both scans have, or scan so that more of the thing is in both.",
            )
        base, number = best
        poses[number] = poses[base] @ found[best][0].pose
        doubts[number] = _doubts(found[best], names[number])
    return [poses[number] for number in range(len(samples))], [doubts[n] for n in range(len(samples))]


def _doubts(ways: Sequence[Candidate], name: str) -> tuple[str, ...]:
    best = ways[0]
    doubts = []
    if best.score < CONVINCING:
        doubts.append(f"{name} shares little surface with the others: {100.0 * best.overlap:.0f} % of it.")
    if best.carved > MOST_CARVED:
        doubts.append(f"{name} has surface where another scan saw through.")
    if len(ways) > 1 and ways[1].score > _RIVAL * best.score:
        doubts.append(f"{name} fits in more than one way, such as a thing with two like sides does.")
    return tuple(doubts)


def _fine(samples: Sequence[Sample], cell_mm: float | None) -> tuple[list[Searched], float]:
    """The samples for the fine alignment, and the edge of their cells, mm."""
    if cell_mm is None:
        cell_mm = max(sample.about(_FINE_POINTS)[1] for sample in samples)
    return [Searched.of(sample.thinned(cell_mm)) for sample in samples], cell_mm


def _links(
    scans: Sequence[Searched], poses: Sequence[RigidTransform], reach_mm: float
) -> list[tuple[int, int]]:
    """Which scans lie on each other."""
    links = []
    for one in range(len(scans)):
        for other in range(one + 1, len(scans)):
            pairs = Partners.between(scans[one].sample, poses[one], scans[other], poses[other], reach_mm)
            if len(pairs) > _LEAST_OVERLAP * min(len(scans[one].sample), len(scans[other].sample)):
                links.append((one, other))
    return links


def _placements(
    scans: Sequence[Searched],
    poses: Sequence[RigidTransform],
    doubts: Sequence[tuple[str, ...]],
    reach_mm: float,
) -> list[tuple[Placement, Floats]]:
    """Where each lies, and how far its points are from those of the others, mm."""
    placements = []
    for one, scan in enumerate(scans):
        is_shared = np.zeros(len(scan.sample), np.bool_)
        apart = [np.zeros(0)]
        for other in range(len(scans)):
            if other != one:
                pairs = Partners.between(scan.sample, poses[one], scans[other], poses[other], reach_mm)
                is_shared[pairs.which] = True
                apart.append(pairs.apart_mm)
        residuals = np.concatenate(apart)
        placements.append(
            (Placement(poses[one], spread(residuals), float(is_shared.mean()), not doubts[one]), residuals)
        )
    return placements


def _notes(clouds: Sequence[PointCloud], things: Sequence[PointCloud]) -> tuple[str, ...]:
    lost = sum(len(cloud) - len(thing) for cloud, thing in zip(clouds, things, strict=True))
    return (
        (f"{lost:,} points were left out: the table, copies, and points without a normal.",) if lost else ()
    )
