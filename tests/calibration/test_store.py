"""A folder of dated calibrations."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from app.calibration.record import CalibrationRecord
from app.calibration.store import CalibrationStore
from app.errors import CalibrationFileError
from app.geometry.camera import CameraIntrinsics


def record(day: int, method: str) -> CalibrationRecord:
    camera = CameraIntrinsics(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), (640, 480))
    return CalibrationRecord(camera=camera, method=method, created=datetime(2026, 11, day, tzinfo=UTC))


def test_the_newest_is_the_one_with_the_latest_date(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path / "store")
    for day, method in ((12, "second"), (30, "third"), (9, "first")):
        store.save(record(day, method))
    assert store.newest().method == "third"
    assert [CalibrationRecord.load(path).method for path in store.paths()] == ["first", "second", "third"]


def test_two_of_the_same_second_are_both_kept(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    for method in ("one", "two", "three"):
        store.save(record(1, method))
    assert [CalibrationRecord.load(path).method for path in store.paths()] == ["one", "two", "three"]


def test_an_empty_store_says_so(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match="holds no calibration yet"):
        CalibrationStore(tmp_path / "nowhere").newest()
