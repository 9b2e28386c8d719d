"""The truth beside a simulated recording: a calibration file that says a little more."""

import numpy as np

from app.documents import Json
from app.geometry.transform import RigidTransform
from app.recording.simulated_plan import SimulationPlan
from app.recording.simulated_stops import Stop
from app.simulation.boards import platter_poses

TRUTH_FILE = "truth.json"
TRUTH_MESH_FILE = "truth.stl"
# A simulation has no date, and the same seed gives the same bytes.
_CREATED = "2000-01-01T00:00:00Z"


def truth_document(plan: SimulationPlan, frames: list[Json]) -> Json:
    """`truth.json`: calibration file, version 1, with the key `truth`.

    Under it: `object` (name, `scan_from_object`, what is known of its shape in its own frame, for a sphere
    the centre in the scan frame), `frames` (see `frame_truth`), `lasers` (where each stands, camera frame,
    and how thick its sheet is), `platter` (`scan_from_marker` of each id), noise, lighting and seed.
    """
    rig = plan.scanner.rig
    width, height = rig.camera.size
    return {
        "format": "turnscan-calibration",
        "version": 1,
        "created": _CREATED,
        "camera": {
            "width": width, "height": height, "matrix": rig.camera.matrix.tolist(),
            "distortion": rig.camera.distortion.tolist(), "rms_px": 0.0,
        },
        "lasers": {
            name: {"normal": plane.normal.tolist(), "distance_mm": float(plane.distance_mm), "rms_mm": 0.0}
            for name, plane in rig.lasers.items()
        },
        "axis": {
            "point_mm": rig.axis.point_mm.tolist(), "direction": rig.axis.direction.tolist(), "rms_mm": 0.0,
        },
        "table": {"offset_mm": float(rig.axis.offset_mm)},
        "method": "truth",
        "expected_error_mm": 0.0,
        "truth": {
            "seed": plan.seed,
            "object": _object(plan),
            "table_radius_mm": plan.scanner.table_radius_mm,
            "lasers": {
                name: {
                    "position_mm": source.position_mm.tolist(), "sigma_mm": source.sigma_mm,
                    "focus_mm": source.focus_mm, "peak_grey": source.peak_grey,
                }
                for name, source in plan.scanner.sources.items()
            },
            "noise": {
                "speckle": plan.noise.speckle, "read_grey": plan.noise.read_grey,
                "electrons_per_grey": _or_none(plan.noise.electrons_per_grey),
            },
            "platter": {} if plan.platter is None else {
                str(number): _matrix(pose)
                for number, pose in zip(
                    plan.platter.ids, platter_poses(plan.platter, plan.scanner.table_radius_mm), strict=True
                )
            },
            "frames": frames,
        },
    }  # fmt: skip


def frame_truth(file: str, plan: SimulationPlan, stop: Stop) -> Json:
    """One frame: its file, where the table truly stood (as the recording counts angles), and the board."""
    truth: Json = {"file": file, "angle_deg": float(np.degrees(stop.angle_rad)) * plan.turn_sign}
    if stop.has_board:
        truth["camera_from_board"] = _matrix(stop.camera_from_board)
    return truth


def _object(plan: SimulationPlan) -> Json:
    where = plan.table_from_item
    described: Json = {
        "name": plan.item.name, "scan_from_object": _matrix(where), "in_object_frame": dict(plan.item.facts),
    }  # fmt: skip
    if "centre_mm" in plan.item.facts:
        centre = np.asarray(plan.item.facts["centre_mm"], np.float64)
        described["centre_mm"] = (where @ centre[None])[0].tolist()
    return described


def _matrix(motion: RigidTransform) -> list[list[float]]:
    """(4, 4), row by row."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = motion.rotation, motion.translation
    rows: list[list[float]] = matrix.tolist()
    return rows


def _or_none(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None
