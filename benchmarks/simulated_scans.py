"""From a simulated recording to points in the true table frame."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.sample import sample_surface

from app.calibration.calibrate import calibrate
from app.calibration.plan import CalibrationPlan, Method
from app.calibration.record import CalibrationRecord
from app.geometry.arrays import Floats, Points
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.scanning.agreement import LaserAgreement
from app.scanning.sources import reconstruct_recording, scan_detector
from app.vision.stripe import STRIPE_DETECTORS

_DENSE = 400_000


@dataclass(frozen=True, eq=False, slots=True)
class Scan:
    """A reconstructed scan.

    Attributes:
        points: (N, 3) mm in the found rig's own table frame.
        laser: (N,) number of the laser.
        agreements: of every pair of lasers.
    """

    points: Points
    laser: NDArray[np.uint8]
    agreements: tuple[LaserAgreement, ...]

    def seen_by_camera_of(self, found: Rig, truth: Rig) -> Points:
        """The points in the true table frame: both rigs share the camera."""
        points: Points = truth.axis.camera_from_table.inverse() @ (found.axis.camera_from_table @ self.points)
        return points


def true_record(recording: Recording) -> CalibrationRecord:
    return CalibrationRecord.load(Path(recording.folder) / "truth.json")


def calibrated(recording: Recording, method: Method) -> CalibrationRecord:
    """As the command line does it, with the detector that belongs to the method."""
    detector = STRIPE_DETECTORS.make("threshold" if method == "paper" else "zero-crossing")
    return calibrate([recording], detector, CalibrationPlan(method)).record


def scanned(recording: Recording, rig: Rig, detector: str = "zero-crossing", **options: Any) -> Scan:
    run = reconstruct_recording(recording, rig, scan_detector(detector, **options))
    clouds = [profile.cloud for profile in run]
    return Scan(
        np.concatenate([cloud.points for cloud in clouds]).astype(np.float64),
        np.concatenate([cloud.laser for cloud in clouds]),
        run.report().agreements,
    )


def distances_mm(points: Points, surface: Trimesh) -> Floats:
    """Distance (N,) of points to a surface, by the plane of the nearest of many samples."""
    samples, faces = sample_surface(surface, _DENSE, seed=0)
    away, index = cKDTree(samples).query(points)
    along = np.abs(np.sum((points - samples[index]) * surface.face_normals[faces[index]], axis=1))
    # Beyond an edge the plane passes too near; there the sample itself tells.
    distances: Floats = np.where(away < 1.0, along, away)
    return distances
