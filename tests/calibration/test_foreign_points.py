"""Points of an imported calibration are those of the other program, however pictures are turned."""

import json
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign_files import (
    ANGLES_DEG,
    fabscan_file,
    horus_file,
    in_the_bench,
    in_the_sensor,
    our_points,
    stripe,
    their_points,
)
from numpy.testing import assert_allclose
from scipy.spatial.distance import pdist

from app.calibration.foreign.importing import import_calibration
from app.calibration.record import CalibrationRecord
from app.devices.frame import Mounting, Rotation
from app.geometry.arrays import Points
from app.geometry.rig import Rig
from app.simulation.rig import standard_rig

FLIPS = tuple(product((False, True), repeat=3))
ROTATIONS: tuple[Rotation, ...] = (0, 90, 180, 270)
Write = Callable[..., dict[str, Any]]
PROGRAMS = [pytest.param(horus_file, -1.0, id="horus"), pytest.param(fabscan_file, 1.0, id="fabscan")]


def imported(folder: Path, document: dict[str, Any], bench: Mounting) -> CalibrationRecord:
    path = folder / "calibration.json"
    path.write_text(json.dumps(document))
    return import_calibration(path, bench)


def is_proper(flips: tuple[bool, bool, bool]) -> bool:
    return sum(flips) % 2 == 0


def handedness(points: Points) -> float:
    """Sign of the volume that four points span."""
    a, b, c, d = points[[0, len(points) // 3, 2 * len(points) // 3, -1]]
    return float(np.sign(np.linalg.det([b - a, c - a, d - a])))


@pytest.mark.parametrize(("write", "sign"), PROGRAMS)
@pytest.mark.parametrize("size", [(960, 1280), (1280, 720)])
@pytest.mark.parametrize("is_bent", [False, True])
def test_a_picture_turned_as_the_program_does_gives_the_very_same_rig(
    write: Write, sign: float, size: tuple[int, int], is_bent: bool, tmp_path: Path
) -> None:
    rig = standard_rig(*size, distortion=None if is_bent else np.zeros(5)).rig
    bench = Mounting(90) if size == (960, 1280) else Mounting()
    flips = (True, True, False) if size == (960, 1280) else (False, False, False)
    record = imported(tmp_path, write(rig, flips=flips), bench)
    assert record.camera.size == size
    assert_allclose(record.camera.matrix, rig.camera.matrix, rtol=1e-14)
    assert_allclose(record.camera.distortion, rig.camera.distortion)
    assert record.axis is not None
    assert_allclose(record.axis.origin, rig.axis.origin, rtol=1e-12)
    for laser, plane in rig.lasers.items():
        assert_allclose(record.lasers[laser].normal, plane.normal, atol=1e-14)
        for angle_deg in ANGLES_DEG:
            theirs = their_points(rig, stripe(rig), laser, angle_deg, sign)
            ours = our_points(record, stripe(rig), laser, angle_deg)
            # Both count from the axis at the table; only where x points to differs.
            assert_allclose(ours[:, 2], theirs[:, 2], atol=1e-8)
            between = np.arctan2(ours[:, 1], ours[:, 0]) - np.arctan2(theirs[:, 1], theirs[:, 0])
            assert_allclose(np.hypot(*ours[:, :2].T), np.hypot(*theirs[:, :2].T), atol=1e-8)
            assert_allclose(np.exp(1j * between), np.exp(1j * between[0]), atol=1e-8)


@pytest.mark.parametrize(("write", "sign"), PROGRAMS)
@pytest.mark.parametrize("flips", FLIPS)
def test_every_turn_of_a_picture_gives_the_same_points(
    write: Write, sign: float, flips: tuple[bool, bool, bool], tmp_path: Path
) -> None:
    rig = standard_rig(768, 1024).rig
    sensor_size = rig.camera.size[::-1] if flips[0] else rig.camera.size
    pixels = stripe(rig)
    theirs = _all(rig, partial(their_points, rig, pixels, sign=sign))
    for rotation, mirror in product(ROTATIONS, (False, True)):
        record = imported(tmp_path, write(rig, flips=flips), Mounting(rotation, mirror))
        seen = in_the_bench(in_the_sensor(pixels, sensor_size, flips), sensor_size, rotation, mirror)
        ours = _all(rig, partial(our_points, record, seen))
        assert record.camera.size == (sensor_size if rotation in (0, 180) else sensor_size[::-1])
        assert_allclose(pdist(ours), pdist(theirs), atol=1e-6)
        assert_allclose(ours[:, 2], theirs[:, 2], atol=1e-6)
        # A picture that one of the two mirrors and the other does not shows a mirrored object.
        is_same_hand = is_proper(flips) != mirror
        assert (handedness(ours) == handedness(theirs)) == is_same_hand


def _all(rig: Rig, points: Callable[..., Points]) -> Points:
    return np.concatenate(
        [points(laser=laser, angle_deg=angle) for laser in rig.lasers for angle in ANGLES_DEG]
    )


@pytest.mark.parametrize(("write", "sign"), PROGRAMS)
def test_rounding_to_three_decimals_costs_little(write: Write, sign: float, tmp_path: Path) -> None:
    true = standard_rig(960, 1280).rig
    document = write(true)
    group = document.get("calibration_settings") or document["calibration"]
    for name in ("camera_matrix", "distortion_vector"):
        numbers = group[name]["value"] if isinstance(group[name], dict) else group[name]
        rounded = np.round(np.array(numbers), 3).tolist()
        group[name] = {"value": rounded} if isinstance(group[name], dict) else rounded
    record = imported(tmp_path, document, Mounting(90))
    here = true.triangulate(stripe(true), "left", 0.0)
    there = record.rig.triangulate(stripe(true), "left", 0.0)
    error = np.linalg.norm(here - there, axis=1)
    assert 1e-5 < error.max() < 0.05
