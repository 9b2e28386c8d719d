"""Calibration files keep every bit, and refuse what cannot be a rig."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError, OutputError, ScannerError
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane

LENGTHS = st.floats(-1e4, 1e4)
VECTORS = st.tuples(LENGTHS, LENGTHS, LENGTHS).map(np.array)
DIRECTIONS = VECTORS.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
RESIDUALS = st.just(float("nan")) | st.floats(0.0, 1e3)
NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8)
JSON: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@st.composite
def records(draw: st.DrawFn) -> CalibrationRecord:
    fx, fy, cx, cy = (draw(st.floats(1e-3, 1e5)) for _ in range(4))
    distances = LENGTHS.filter(lambda d: d != 0.0)
    planes = st.builds(lambda n, d: LaserPlane(n if n[2] >= 0.0 else -n, d), DIRECTIONS, distances)
    axes = st.builds(TurntableAxis, VECTORS, DIRECTIONS, st.just(float("nan")) | LENGTHS)
    return CalibrationRecord(
        camera=CameraIntrinsics(
            np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
            np.array([draw(st.floats(-2.0, 2.0)) for _ in range(5)]),
            (draw(st.integers(1, 9000)), draw(st.integers(1, 9000))),
        ),
        lasers=draw(st.dictionaries(NAMES, planes, max_size=3)),
        axis=draw(st.none() | axes),
        rms_px=draw(RESIDUALS),
        axis_rms_mm=draw(RESIDUALS),
        expected_error_mm=draw(RESIDUALS),
        method=draw(st.text(st.characters(codec="utf-8"), max_size=8)),
        created=draw(st.datetimes(datetime(1950, 1, 1), datetime(2100, 1, 1), timezones=st.just(UTC))),  # noqa: DTZ001
    )


@given(records())
def test_a_record_comes_back_to_the_last_bit(record: CalibrationRecord) -> None:
    back = CalibrationRecord.parse(record.to_bytes(), "test")
    assert_array_equal(back.camera.matrix, record.camera.matrix)
    assert_array_equal(back.camera.distortion, record.camera.distortion)
    assert back.camera.size == record.camera.size
    assert list(back.lasers) == list(record.lasers)
    for name, plane in record.lasers.items():
        assert_array_equal(back.lasers[name].normal, plane.normal)
        assert back.lasers[name].distance_mm == plane.distance_mm
    assert (back.axis is None) == (record.axis is None)
    if back.axis is not None and record.axis is not None:
        assert_array_equal(back.axis.point_mm, record.axis.point_mm)
        assert_array_equal(back.axis.direction, record.axis.direction)
        assert_array_equal(back.axis.offset_mm, record.axis.offset_mm)
        assert_array_equal(back.axis_rms_mm, record.axis_rms_mm)
    assert_array_equal(back.rms_px, record.rms_px)
    assert_array_equal(back.expected_error_mm, record.expected_error_mm)
    assert (back.method, back.created) == (record.method, record.created)


def example() -> dict[str, Any]:
    """The file of the format's own description."""
    return {
        "format": "turnscan-calibration",
        "version": 1,
        "created": "2026-11-21T10:00:00Z",
        "camera": {
            "width": 1280,
            "height": 720,
            "matrix": [[1400.0, 0, 640], [0, 1400.0, 360], [0, 0, 1]],
            "distortion": [0.1, 0, 0, 0, 0],
            "rms_px": 0.21,
        },
        "lasers": {"left": {"normal": [0.6, 0.0, 0.8], "distance_mm": 150.0, "rms_mm": 0.05}},
        "axis": {"point_mm": [0.0, 0, 300], "direction": [0, -1, 0], "rms_mm": 0.03},
        "table": {"offset_mm": -20.0},
        "method": "joint",
        "expected_error_mm": 0.02,
    }


def parsed(document: object) -> CalibrationRecord:
    return CalibrationRecord.parse(json.dumps(document).encode(), "cal.json")


def test_the_formats_own_example_is_a_rig() -> None:
    record = parsed(example())
    assert record.rig.axis.offset_mm == -20.0
    assert (record.rms_px, record.laser_rms_mm, record.axis_rms_mm) == (0.21, {"left": 0.05}, 0.03)
    assert record.created == datetime(2026, 11, 21, 10, tzinfo=UTC)


def test_unknown_keys_are_kept_at_every_level(tmp_path: Path) -> None:
    document = example()
    document["covariance"] = [[1e-7, 0.0]]
    document["camera"]["std"] = {"fx": 0.1}
    document["lasers"]["left"]["spread_mm"] = [1.0, 2.0, 3.0]
    document["axis"]["chi"] = 1.01
    document["table"]["tilt_deg"] = 0.2
    parsed(document).save(tmp_path / "cal.json")
    assert json.loads((tmp_path / "cal.json").read_text()) == document


def test_an_extra_key_never_replaces_what_is_known() -> None:
    record = parsed(example())
    spoiled = CalibrationRecord(camera=record.camera, extra={"camera": {"width": 1, "lens": "8 mm"}})
    saved = json.loads(spoiled.to_bytes())
    assert (saved["camera"]["width"], saved["camera"]["lens"]) == (1280, "8 mm")


@pytest.mark.parametrize(
    ("path", "value", "problem"),
    [
        (["camera", "matrix", 0, 0], -5.0, r"camera\.matrix: focal lengths must be greater than 0"),
        (["camera", "matrix", 0, 1], 0.5, r"camera\.matrix: must be \[\[fx, 0, cx\]"),
        (["camera", "width"], 0, r"camera\.width: must be greater than 0, not 0"),
        (["camera", "distortion"], [0.1] * 4, r"camera\.distortion"),
        (["lasers", "left", "normal"], [0.6, 0.0, 0.9], r"lasers\.left\.normal: must be a unit vector"),
        (["lasers", "left", "normal"], [0.6, 0.0, -0.8], r"lasers\.left\.normal: must have positive z"),
        (["lasers", "left", "distance_mm"], 0, r"lasers\.left\.distance_mm: is 0"),
        (["axis", "direction"], [0, 0, 0], r"axis\.direction: must be a unit vector"),
        (["axis", "point_mm", 1], float("nan"), r"axis\.point_mm\[1\]: must be a finite number"),
        (["axis", "rms_mm"], -1, r"axis\.rms_mm: must be greater than or equal to 0"),
        (["created"], "yesterday", "created: must be a time"),
        (["version"], 2, "version: must be 1, not 2"),
        (["format"], "turnscan-recording", "format: must be 'turnscan-calibration'"),
    ],
)
def test_a_value_that_cannot_be_is_named(path: list[str | int], value: object, problem: str) -> None:
    document: Any = example()
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(CalibrationFileError, match=f"^cal\\.json: {problem}"):
        parsed(document)


def test_a_camera_alone_is_a_record_but_no_rig() -> None:
    document = example()
    del document["lasers"], document["axis"], document["table"]
    record = parsed(document)
    with pytest.raises(CalibrationFileError, match="holds no laser plane"):
        _ = record.rig


def test_a_normal_copied_from_a_paper_is_scaled_with_its_distance() -> None:
    document = example()
    document["lasers"]["left"] = {"normal": [0.6003, 0.0, 0.8004], "distance_mm": 100.05}
    plane = parsed(document).lasers["left"]
    assert plane.normal == pytest.approx([0.6, 0.0, 0.8])
    assert plane.distance_mm == pytest.approx(100.0)


def test_values_no_reader_would_take_are_not_written(tmp_path: Path) -> None:
    record = parsed(example())
    with pytest.raises(CalibrationFileError, match=r"cannot be written: .*nan"):
        CalibrationRecord(
            camera=CameraIntrinsics(np.full((3, 3), np.nan), np.zeros(5), record.camera.size)
        ).save(tmp_path / "cal.json")
    with pytest.raises(CalibrationFileError, match="cannot be written"):
        CalibrationRecord(camera=record.camera, extra={"views": np.zeros(3)}).save(tmp_path / "cal.json")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_and_a_missing_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match=r"none\.json: no such file"):
        CalibrationRecord.load(tmp_path / "none.json")
    with pytest.raises(OutputError, match="no such file"):
        parsed(example()).save(tmp_path / "none" / "cal.json")


@given(data=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
def test_bytes_of_any_kind_are_an_error_and_no_surprise(data: bytes) -> None:
    with pytest.raises(CalibrationFileError):
        CalibrationRecord.parse(data, "cal.json")


@given(spoil=st.data())
def test_a_spoiled_file_is_an_error_or_still_a_record(spoil: st.DataObject) -> None:
    document: Any = example()
    place = document
    while True:
        key = spoil.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        inner = place[key]
        if not isinstance(inner, dict | list) or not inner or spoil.draw(st.booleans()):
            break
        place = inner
    place[key] = spoil.draw(JSON)
    try:
        record = parsed(document)
    except ScannerError:
        return
    CalibrationRecord.parse(record.to_bytes(), "again")
