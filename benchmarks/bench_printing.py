"""Meshes for printing: are they closed, and how much of what the scanner could see do they show, how well?"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from trimesh import Trimesh, load_mesh
from trimesh.sample import sample_surface

from app.cli.main import run as turnscan
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan
from app.recording.simulated_stops import scan_stops
from app.simulation.objects import make_object, object_names
from app.simulation.render import renderer_of
from app.surface.finish import Finish, Preset, finish
from app.surface.ply_reader import read_ply
from benchmarks.report import Row, at_least, at_most
from benchmarks.seen_points import put_down, seen

_TILTS = ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.9, 0.0), (0.5 * np.pi, 0.0, 0.0), (np.pi, 0.0, 0.0))
_POINTS = 60_000
_SCANNED = {"sphere": 0.06, "mug": 0.1, "rabbit": 0.1}
_STEPS = 200
_TRUE_POINTS = 80_000
_SAMPLES = 1_500_000
_LEAST_GREY = 10.0
_LIT_WITHIN_MM = 0.2
# Two pixels at the object.
_NEAR_MM = 0.5


def run() -> list[Row]:
    rows = [_closed()]
    with tempfile.TemporaryDirectory() as folder:
        for name, limit_mm in _SCANNED.items():
            rows += _scanned(Path(folder) / name, name, limit_mm)
    return rows


def _closed() -> Row:
    """Every object, put down in five ways, from what a camera sees of it."""
    rng = np.random.default_rng(0)
    count, open_ones = 0, []
    for name in object_names():
        mesh = make_object(name).mesh
        for tilt in _TILTS:
            cloud = seen(mesh, put_down(mesh, np.array(tilt), rng), _POINTS, rng)
            count += 1
            if not _is_printable(cloud):
                open_ones.append(f"{name} {tilt}")
    what = f"watertight for print, of {count} objects put down somehow"
    return at_least(what, count - len(open_ones), "", count, "; ".join(open_ones))


def _is_printable(cloud: PointCloud) -> bool:
    mesh = finish([cloud], Finish(preset=Preset.PRINT)).mesh
    if mesh is None:
        return False
    read = Trimesh(mesh.vertices, mesh.faces, process=False)
    return bool(read.is_watertight and read.is_winding_consistent and read.volume > 0.0)


def _scanned(folder: Path, name: str, limit_mm: float) -> list[Row]:
    """Simulated pictures to a mesh by the command line, against the object as far as the scanner saw it."""
    plan = SimulationPlan(item=make_object(name), parts=("scan",), steps=_STEPS)
    recording = simulate_recording(folder, plan)
    cloud, printed = folder / "cloud.ply", folder / "print.stl"
    truth_file = Path(recording.folder) / "truth.json"
    for words in (
        ["reconstruct", str(recording.folder), "-c", str(truth_file), "-o", str(cloud)],
        ["surface", str(cloud), "-o", str(printed)],
    ):
        if turnscan(words) != 0:
            raise RuntimeError(f"turnscan {words[0]} failed")
    mesh = load_mesh(printed)
    pose = plan.table_from_item
    truth = Trimesh(pose @ plan.item.mesh.vertices, plan.item.mesh.faces, process=False)
    points, _ = _sampled(truth, _TRUE_POINTS)
    lit = cKDTree(_lit_places(plan)).query(points, workers=-1)[0] < _LIT_WITHIN_MM
    shown = _share_near(points[lit], _sampled(mesh, _SAMPLES)[0], _NEAR_MM)
    measured = _share_near(points[lit], read_ply(cloud).points, 1.0)
    dense, dense_normals = _sampled(truth, _SAMPLES)
    vertices = np.asarray(mesh.vertices, np.float64)
    vertices = vertices[cKDTree(points[lit]).query(vertices, workers=-1)[0] < _NEAR_MM]
    beside = cKDTree(dense).query(vertices, workers=-1)[1]
    errors = np.einsum("ij,ij->i", vertices - dense[beside], dense_normals[beside])
    visible = 100.0 * float(np.mean(lit))
    note = f"{_STEPS} stops at 720p, {len(mesh.faces):,} triangles, {visible:.0f} % of it visible"
    near = f"within {_NEAR_MM} mm; {measured:.1f} % of it within 1 mm of a point of the cloud"
    return [
        at_most(f"{name}, scanned: RMS from the truth", _rms(errors), "mm", limit_mm, note),
        at_least(f"{name}, scanned: visible surface in the mesh", shown, "%", 98.0, near),
        at_least(f"{name}, scanned: watertight", float(mesh.is_watertight), "", 1.0),
    ]  # fmt: skip


def _lit_places(plan: SimulationPlan) -> Points:
    """(N, 3) every place that a laser lights for the camera, on the table: what a scanner can see at all."""
    places = []
    for stop in scan_stops(plan):
        renderer = renderer_of(stop.scene)
        view = renderer.look(stop.angle_rad)
        depth = view.depth
        table_from_camera = plan.scanner.rig.axis.table_from_camera(stop.angle_rad)
        for laser in plan.scanning_lasers:
            rows, columns = np.nonzero((renderer.irradiance(view, laser) > _LEAST_GREY) & np.isfinite(depth))
            rays = np.column_stack([view.still.rays[rows, columns], np.ones(len(rows))])
            places.append(table_from_camera @ (rays * depth[rows, columns, None]))
    return np.concatenate(places)


def _share_near(points: Points, others: Points | NDArray[np.float32], within_mm: float) -> float:
    """Percent of points (N, 3) that have one of others (M, 3) so near."""
    return 100.0 * float(np.mean(cKDTree(others).query(points, workers=-1)[0] < within_mm))


def _sampled(mesh: Trimesh, count: int) -> tuple[Points, Points]:
    """Points of a surface, and its normals there."""
    points, faces = sample_surface(mesh, count, seed=0)
    return np.asarray(points, np.float64), np.asarray(mesh.face_normals[faces], np.float64)


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))
