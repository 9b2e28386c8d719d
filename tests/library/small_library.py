"""Tiny scans, made in a moment."""

import json
from pathlib import Path

import cv2
import numpy as np

from app.geometry.cloud import PointCloud
from app.library.library import Library
from app.recording.manifest import Header
from app.recording.shot import Role
from app.recording.writer import RecordingWriter
from app.surface.ply import write_ply

PICTURE: bytes = cv2.imencode(".png", np.zeros((6, 8, 3), np.uint8))[1].tobytes()
HEADER = Header.of((8, 6), {"left": "red"})


def make_recording(folder: Path, pictures: int = 3) -> Path:
    """A recording of black pictures."""
    with RecordingWriter.create(folder, HEADER) as writer:
        add_pictures(writer, pictures)
    return folder


def make_scan(folder: Path, pictures: int = 3, status: str = "finished") -> Path:
    """A scan that this program might have made."""
    make_recording(folder, pictures)
    write_scan_file(folder, status)
    return folder


def add_pictures(writer: RecordingWriter, count: int) -> None:
    for number in range(count):
        writer.append_encoded(PICTURE, Role.SCAN, ("left",), 30.0 * number)


def write_scan_file(folder: Path, status: str) -> None:
    document = {
        "format": "turnscan-scan", "version": 1, "bench": "simulated", "status": status,
        "plan": {"lasers": ["left"]}, "table": {},
    }  # fmt: skip
    (folder / "scan.json").write_text(json.dumps(document))


def make_cloud(points: int) -> PointCloud:
    """Points on a ball."""
    random = np.random.default_rng(points)
    normals = random.normal(size=(points, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(
        (30.0 * normals).astype(np.float32), normals.astype(np.float32), np.full((points, 3), 200, np.uint8),
        np.full(points, 0.1, np.float32), np.zeros(points, np.uint8), np.zeros(points, np.float32),
        np.ones(points, np.float32), ("left",),
    )  # fmt: skip


def make_ply(path: Path, points: int = 50) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_ply(path, make_cloud(points))
    return path


def library_with(folder: Path, *names: str) -> Library:
    """A library with these scans."""
    for name in names:
        make_scan(folder / name)
    return Library(folder)


def left_over(library: Library) -> list[str]:
    """Whatever lies in the library's work folder."""
    return [path.name for path in (library.folder / ".work").glob("*")]
