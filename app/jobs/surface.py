"""The surface job: a cloud of a scan becomes a mesh, kept in the scan's own folder."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.files import make_folder, write_whole
from app.geometry.mesh import TriangleMesh
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.derived import keep_cloud
from app.library.library import Library
from app.library.meshes import MESHES_FOLDER
from app.library.names import free_name
from app.surface.exports.write import mesh_parts, write_mesh
from app.surface.finish import Finish, Finished, finish
from app.surface.thinning import read_thinned

_PARTS = 1000
# What people take home most; their sizes are told beside the buttons.
_FORMS = ("stl", "3mf", "obj", "glb")


def surface_work(
    library: Library, name: str, cloud: str, order: Finish, *, keeps_cloud: bool = False
) -> Work:
    """Clean a cloud and make its surface; the cloud itself and earlier meshes stay.

    Args:
        library, name: the scan.
        cloud: which one; the newest where none is named.
        order: what is wanted.
        keeps_cloud: whether the cleaned cloud becomes another cloud of the scan.
    """

    def work(job: JobContext) -> Mapping[str, Any]:
        item = library.scan(name)
        source = cloud_of(item, cloud)
        named = source.relative_to(item.folder).as_posix()

        def progress(words: str, share: float) -> None:
            job.checkpoint()
            job.progress(round(0.95 * _PARTS * share), _PARTS, words)

        read = read_thinned(source, order.most_points)
        done = finish([read.cloud], order, progress)
        job.checkpoint()
        job.progress(round(0.95 * _PARTS), _PARTS, "writing")
        facts = _facts(named, read.points, done)
        if keeps_cloud:
            how = {"made_by": "cleaned", "of": named, "steps": facts["steps"]}
            words = f"Cleaned {named}: {len(done.cloud)} of {read.points} points are left."
            facts["cleaned"] = keep_cloud(library, name, done.cloud, how, words).name
        if done.mesh is not None:
            facts |= _keep_mesh(item.folder, done.mesh, order, facts)
        return facts

    return work


def _facts(cloud: str, points: int, done: Finished) -> dict[str, Any]:
    report = done.report
    return {
        "cloud": cloud, "points": points, "used_points": len(done.cloud), "notes": list(report.notes),
        "doubts": list(report.doubts), "guessed_share": report.guessed_share,
        "steps": [asdict(step) for step in report.steps],
        "printing": None if report.printing is None else asdict(report.printing),
    }  # fmt: skip


def _keep_mesh(scan: Path, mesh: TriangleMesh, order: Finish, facts: Mapping[str, Any]) -> Mapping[str, Any]:
    """Write it with what is known of it; its name and what it comes to."""
    folder = scan / MESHES_FOLDER
    make_folder(folder)
    path = folder / free_name(folder, f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}Z-{order.preset}", ".ply")
    sizes = {form: sum(len(part) for part in mesh_parts(f".{form}", mesh)) for form in _FORMS}
    made = {"mesh": path.name, "triangles": len(mesh), "sizes": sizes}
    how = {"order": order.model_dump(mode="json"), **facts, **made}
    # First, so that whoever sees the mesh knows how it was made.
    write_whole(path.with_suffix(".json"), json.dumps(how, indent=1).encode(), is_durable=False)
    write_mesh(path, mesh)
    return made
