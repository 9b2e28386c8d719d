"""A folder of dated calibrations, one of them in use."""

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


@pytest.fixture
def store(tmp_path: Path) -> CalibrationStore:
    """Three calibrations, kept on three days in another order; nobody has chosen one."""
    store = CalibrationStore(tmp_path / "store")
    for day, method in ((12, "second"), (30, "third"), (9, "first")):
        store.save(record(day, method))
    (store.folder / "current").unlink()
    return store


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_they_are_listed_by_date(store: CalibrationStore) -> None:
    assert [kept.record.method for kept in store.kept() if kept.record] == ["first", "second", "third"]
    assert [kept.name[:10] for kept in store.kept()] == ["2026-11-09", "2026-11-12", "2026-11-30"]


def test_without_a_choice_the_one_with_the_latest_date_is_used(store: CalibrationStore) -> None:
    assert store.current().method == "third"
    assert [kept.is_current for kept in store.kept()] == [False, False, True]


def test_a_new_one_is_used_whatever_its_date(store: CalibrationStore) -> None:
    store.save(record(1, "new"))
    assert store.current().method == "new"


def test_one_that_is_only_kept_changes_nothing(store: CalibrationStore) -> None:
    store.save(record(30, "imported"), is_current=False)
    assert "imported" in {kept.record.method for kept in store.kept() if kept.record}
    assert store.current().method == "third"
    store.use("2026-11-09")
    store.save(record(29, "imported"), is_current=False)
    assert store.current().method == "first"


def test_the_first_of_a_store_is_used_even_if_only_kept(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.save(record(1, "only"), is_current=False)
    assert store.current().method == "only"


def test_an_older_one_can_be_used_again(store: CalibrationStore) -> None:
    for name in ("2026-11-12T00-00-00Z", "2026-11-12T00-00-00Z.json", "2026-11-12"):
        store.use(name)
        assert store.current().method == "second"
        store.use("2026-11-30")
    assert CalibrationStore(store.folder).current().method == "third"


def test_current_is_a_name_too(store: CalibrationStore) -> None:
    store.use("2026-11-09")
    assert store.find("current").name == "2026-11-09T00-00-00Z.json"


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("2026-11", "holds 3 calibrations that begin with"),
        ("2025", "holds no calibration '2025'"),
        ("", "holds no calibration"),
        ("../store/2026-11-09T00-00-00Z", "holds no calibration"),
    ],
)
def test_a_name_that_means_none_or_several_is_refused(
    name: str, problem: str, store: CalibrationStore
) -> None:
    for act in (store.find, store.use, store.remove):
        with pytest.raises(CalibrationFileError, match=problem):
            act(name)
    assert len(store.paths()) == 3


def test_two_of_the_same_second_are_both_kept_and_both_can_be_named(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    for method in ("one", "two", "three"):
        store.save(record(1, method))
    assert [CalibrationRecord.load(path).method for path in store.paths()] == ["one", "two", "three"]
    for path, method in zip(store.paths(), ("one", "two", "three"), strict=True):
        store.use(path.stem)
        assert store.current().method == method


def test_a_removed_one_is_in_the_bin_with_its_report_and_comes_back(store: CalibrationStore) -> None:
    path = store.find("2026-11-12")
    path.with_suffix(".html").write_text("the report")
    before = path.read_bytes()
    moved = store.remove("2026-11-12")
    assert store.removed() == (moved,)
    assert moved.read_bytes() == before
    assert [kept.record.method for kept in store.kept() if kept.record] == ["first", "third"]
    assert not path.with_suffix(".html").exists()
    assert store.use("2026-11-12") == path
    assert path.read_bytes() == before
    assert path.with_suffix(".html").read_text() == "the report"
    assert store.current().method == "second"
    assert store.removed() == ()


def test_without_the_one_in_use_the_newest_is(store: CalibrationStore) -> None:
    store.use("2026-11-09")
    store.remove("current")
    assert store.current().method == "third"


def test_two_of_one_name_in_the_bin_do_not_replace_each_other(store: CalibrationStore) -> None:
    store.remove("2026-11-12")
    store.save(record(12, "again"))
    store.remove("2026-11-12")
    assert sorted(CalibrationRecord.load(path).method for path in store.removed()) == ["again", "second"]
    with pytest.raises(CalibrationFileError, match="holds no calibration"):
        store.use("2026-11-12")


def test_a_damaged_file_hides_no_other_and_is_never_used(store: CalibrationStore) -> None:
    store.use("2026-11-09")
    (store.folder / "2026-11-12T00-00-00Z.json").write_text("{")
    damaged = store.kept()[1]
    assert damaged.record is None
    assert "is not JSON" in damaged.problem
    with pytest.raises(CalibrationFileError, match="is not JSON"):
        store.use("2026-11-12")
    assert store.current().method == "first"


@pytest.mark.parametrize(
    ("note", "problem"),
    [
        ("2026-11-21T00-00-00Z.json\n", "which is not there"),
        ("../secret.json", "does not name a calibration"),
        ("", "does not name a calibration"),
        ("a\0b", "does not name a calibration"),
        ("x" * 5000, "which is not there"),
    ],
)
def test_a_choice_that_is_not_there_is_an_error_and_not_another_calibration(
    note: str, problem: str, store: CalibrationStore
) -> None:
    (store.folder / "current").write_text(note)
    with pytest.raises(CalibrationFileError, match=problem) as caught:
        store.current()
    assert "turnscan calibrations use" in caught.value.hint
    assert not any(kept.is_current for kept in store.kept())
    store.use("2026-11-09")
    assert store.current().method == "first"


def test_nothing_but_calibrations_and_the_choice_lies_in_the_store(store: CalibrationStore) -> None:
    store.use("2026-11-09")
    store.remove("2026-11-30")
    assert files(store.folder) == {
        "2026-11-09T00-00-00Z.json",
        "2026-11-12T00-00-00Z.json",
        "bin/2026-11-30T00-00-00Z.json",
        "current",
    }


def test_an_empty_store_says_so(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path / "nowhere")
    with pytest.raises(CalibrationFileError, match="holds no calibration yet"):
        store.current()
    assert store.kept() == ()
    assert store.removed() == ()
