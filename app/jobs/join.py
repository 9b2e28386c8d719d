"""The joining job: several scans of one thing become a new scan of the library."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from app.geometry.transform import RigidTransform
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.derived import new_scan
from app.library.library import Library
from app.surface.joining.options import JoinOptions
from app.surface.thinning import MOST_POINTS, read_thinned

if TYPE_CHECKING:
    from app.surface.joining.join import Joined

_PARTS = 1000
_READING, _JOINING = 0.1, 0.85


def join_work(library: Library, parts: Sequence[tuple[str, str]], options: JoinOptions, title: str) -> Work:
    """Bring clouds into the frame of the first, fuse them, and keep the result; they themselves stay.

    Args:
        library: where they are, and where the result goes.
        parts: names of scans, and of their clouds.
        options: see there.
        title: of the new scan.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        # Loaded here: it takes a while, and few jobs need it.
        from app.surface.joining.join import join

        def progress(words: str, share: float) -> None:
            job.checkpoint()
            job.progress(round(_PARTS * (_READING + _JOINING * share)), _PARTS, words)

        clouds, names, notes, most = [], [], list[str](), MOST_POINTS // len(parts)
        for number, (scan, cloud) in enumerate(parts):
            job.checkpoint()
            job.progress(round(_PARTS * _READING * number / len(parts)), _PARTS, "reading")
            item = library.scan(scan)
            names.append(repr(item.title))
            read = read_thinned(cloud_of(item, cloud), most)
            clouds.append(read.cloud)
            notes += read.notes
        joined = join(clouds, options, progress, names)
        job.checkpoint()
        job.progress(round(_PARTS * (_READING + _JOINING)), _PARTS, "writing")
        facts = _facts(parts, joined, notes)
        how = {"made_by": "joined", "options": options.model_dump(mode="json"), **facts}
        came_to = f"{len(joined.cloud)} points, residual {joined.residual_mm:.3f} mm"
        words = f"Joined of {' and '.join(names)}: {came_to}."
        made = new_scan(library, title, joined.cloud, how, words)
        return {"scan": made.name, "cloud": made.clouds[-1].name, **facts}

    return work


def _facts(parts: Sequence[tuple[str, str]], joined: "Joined", notes: Sequence[str]) -> dict[str, Any]:
    placements = [
        {
            "scan": scan, "cloud": cloud, "pose": _matrix(placed.pose), "residual_mm": placed.residual_mm,
            "overlap": placed.overlap, "is_sure": placed.is_sure,
        }
        for (scan, cloud), placed in zip(parts, joined.placements, strict=True)
    ]  # fmt: skip
    return {
        "points": len(joined.cloud), "residual_mm": joined.residual_mm, "placements": placements,
        "notes": [*notes, *joined.notes], "doubts": list(joined.doubts),
    }  # fmt: skip


def _matrix(pose: RigidTransform) -> list[list[float]]:
    """4x4 by rows: the frame of the first cloud from this one's."""
    rows: list[list[float]] = np.column_stack([pose.rotation, pose.translation]).tolist()
    return [*rows, [0.0, 0.0, 0.0, 1.0]]
