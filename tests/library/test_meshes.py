"""Meshes in a scan's folder: kept whole, never in the folder of a scan that went away."""

from pathlib import Path

import pytest
import trimesh
from small_library import left_over, library_with

from app.errors import ScanNotFound
from app.geometry.mesh import TriangleMesh
from app.library.meshes import erase_mesh, keep_mesh, mesh_of, meshes_of


def test_meshes_are_kept_side_by_side_with_how_they_were_made(tmp_path: Path) -> None:
    library = library_with(tmp_path / "scans", "mug")
    names = [keep_mesh(library, "mug", _box(), {"number": number}, "print") for number in range(2)]
    folder = library.folder_of("mug")
    assert {item.name for item in meshes_of(folder)} == set(names)
    assert len(set(names)) == 2
    assert all(mesh_of(folder, name).made == {"number": number} for number, name in enumerate(names))
    assert erase_mesh(library, "mug", names[0]) > 0
    assert [path.stem for path in (folder / "meshes").iterdir()] == [Path(names[1]).stem] * 2
    assert left_over(library) == []


def test_a_scan_that_was_deleted_meanwhile_does_not_come_back_with_its_mesh(tmp_path: Path) -> None:
    library = library_with(tmp_path / "scans", "mug")
    library.delete("mug")
    with pytest.raises(ScanNotFound):
        keep_mesh(library, "mug", _box(), {}, "print")
    assert not (library.folder / "mug").exists()
    assert left_over(library) == []


def _box() -> TriangleMesh:
    box = trimesh.creation.box([1.0, 2.0, 3.0])
    return TriangleMesh(box.vertices.astype("float32"), box.faces.astype("int32"))
