"""The surface job: a cloud of a scan becomes a mesh, kept in the scan's own folder."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from app.files import make_folder, write_whole
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.library import Library
from app.library.meshes import MESHES_FOLDER
from app.library.names import free_name
from app.surface.exports.write import write_mesh
from app.surface.finish import Finish, finish
from app.surface.thinning import read_thinned

_PARTS = 1000


def surface_work(library: Library, name: str, cloud: str, order: Finish) -> Work:
    """Clean a cloud and make its surface; the cloud itself and earlier meshes stay.

    Args:
        library, name: the scan.
        cloud: which one; the newest where none is named.
        order: what is wanted.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        item = library.scan(name)
        source = cloud_of(item, cloud)

        def progress(words: str, share: float) -> None:
            job.checkpoint()
            job.progress(round(_PARTS * share), _PARTS, words)

        read = read_thinned(source, order.most_points)
        done = finish([read.cloud], order, progress)
        assert done.mesh is not None
        job.checkpoint()
        folder = item.folder / MESHES_FOLDER
        make_folder(folder)
        path = folder / free_name(folder, f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}Z-{order.preset}", ".ply")
        write_mesh(path, done.mesh)
        report = done.report
        facts = {
            "mesh": path.name, "cloud": source.relative_to(item.folder).as_posix(), "points": read.points,
            "used_points": len(done.cloud), "triangles": len(done.mesh), "notes": list(report.notes),
            "doubts": list(report.doubts), "guessed_share": report.guessed_share,
            "steps": [asdict(step) for step in report.steps],
            "printing": None if report.printing is None else asdict(report.printing),
        }  # fmt: skip
        how = {"order": order.model_dump(mode="json"), **facts}
        write_whole(path.with_suffix(".json"), json.dumps(how, indent=1).encode(), is_durable=False)
        return facts

    return work
