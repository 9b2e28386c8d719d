"""The surface job: a cloud of a scan becomes a mesh, kept in the scan's own folder."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from app.geometry.mesh import TriangleMesh
from app.jobs.clouds import cloud_of
from app.jobs.runner import JobContext, Work
from app.library.derived import keep_cloud
from app.library.library import Library
from app.library.mesh_form import MeshForm, mesh_in_form
from app.library.meshes import keep_mesh
from app.surface.finish import Finish, Finished, finish
from app.surface.texture import Texture
from app.surface.thinning import Read, read_thinned

_PARTS = 1000
# What people take home most; their sizes are told beside the buttons.
_FORMS: tuple[MeshForm, ...] = ("stl", "3mf", "obj", "glb")
_TEXTURED_FORMS: tuple[MeshForm, ...] = ("obj-zip",)


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
        facts = _facts(named, read, done)
        if keeps_cloud:
            how = {"made_by": "cleaned", "of": named, "steps": facts["steps"]}
            words = f"Cleaned {named}: {len(done.cloud)} of {read.points} points are left."
            facts["cleaned"] = keep_cloud(library, name, done.cloud, how, words).name
        mesh = done.mesh
        if mesh is not None:
            facts |= {"triangles": len(mesh), "sizes": _sizes(name, mesh, done.texture)}
            how = {"order": order.model_dump(mode="json"), **facts}
            facts["mesh"] = keep_mesh(library, name, mesh, how, order.preset, done.texture)
        return facts

    return work


def _sizes(scan: str, mesh: TriangleMesh, texture: Texture | None) -> dict[str, int]:
    """Bytes of the files of each form."""
    forms = _FORMS if texture is None else (*_FORMS, *_TEXTURED_FORMS)
    return {form: sum(map(len, mesh_in_form(form, mesh, texture, scan))) for form in forms}


def _facts(cloud: str, read: Read, done: Finished) -> dict[str, Any]:
    report = done.report
    return {
        "cloud": cloud, "points": read.points, "used_points": len(done.cloud),
        "notes": [*read.notes, *report.notes], "doubts": list(report.doubts),
        "guessed_share": report.guessed_share, "steps": [asdict(step) for step in report.steps],
        "printing": None if report.printing is None else asdict(report.printing),
    }  # fmt: skip
