"""Calibrations that are kept, chosen, compared and exchanged on the command line."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command_line import files_below, turnscan

from app.calibration.record import CalibrationRecord
from app.calibration.store import CalibrationStore
from app.cli.bench import calibration_for
from app.cli.main import run
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, parse_bench
from app.simulation.rig import standard_rig

RIG = standard_rig().rig
OLD, NEW = "2026-11-01T10-00-00Z", "2026-11-02T10-00-00Z"


def record(day: int, **changes: Any) -> CalibrationRecord:
    return replace(
        CalibrationRecord(
            camera=RIG.camera,
            lasers=RIG.lasers,
            axis=RIG.axis,
            method="joint",
            expected_error_mm=0.02,
            created=datetime(2026, 11, day, 10, tzinfo=UTC),
        ),
        **changes,
    )


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CalibrationStore:
    """Two calibrations; in the second, the table has been lifted and one laser moved."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    store = CalibrationStore(Path("calibration_store"))
    store.save(record(1))
    left = replace(RIG.lasers["left"], distance_mm=RIG.lasers["left"].distance_mm + 0.5)
    axis = replace(RIG.axis, offset_mm=RIG.axis.offset_mm + 1.0)
    store.save(record(2, lasers={**RIG.lasers, "left": left}, axis=axis))
    return store


def horus_file(path: Path) -> Path:
    """A camera and a laser as Horus keeps them, no axis."""
    values = {
        "camera_width": 720, "camera_height": 1280,
        "camera_rotate": True, "camera_hflip": True, "camera_vflip": False,
        "camera_matrix": RIG.camera.matrix.tolist(), "distortion_vector": [0.0] * 5, "use_distortion": False,
        "normal_left": RIG.lasers["left"].normal.tolist(), "distance_left": RIG.lasers["left"].distance_mm,
        "normal_right": [0.0] * 3, "distance_right": 0.0,
        "rotation_matrix": [[0.0] * 3] * 3, "translation_vector": [0.0] * 3,
    }  # fmt: skip
    document = {"calibration_settings": {name: {"value": value} for name, value in values.items()}}
    path.write_text(json.dumps(document))
    return path


def on_standard_output(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    assert run(list(arguments)) == 0
    return json.loads(capsys.readouterr().out)


def test_those_that_are_kept_are_listed_with_the_one_in_use(store: CalibrationStore) -> None:
    (store.folder / "2026-11-03T10-00-00Z.json").write_text("{")
    said = turnscan("calibrations", "list").said
    assert said.index(OLD) < said.index(NEW)
    assert f"in use │ {NEW}" in said
    # The sentence may be broken by the edges of the table.
    assert "JSON" in said


def test_a_program_gets_the_list_on_standard_output(
    store: CalibrationStore, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = on_standard_output(capsys, "calibrations", "list", "--json")
    assert [(kept["name"], kept["is_current"]) for kept in listed] == [(OLD, False), (NEW, True)]
    assert listed[0]["lasers"] == ["left", "right"]
    assert (listed[0]["width"], listed[0]["expected_error_mm"]) == (1280, 0.02)


def test_an_older_one_is_used_again(store: CalibrationStore) -> None:
    assert f"In use: {OLD}" in turnscan("calibrations", "use", "2026-11-01").said
    assert f"in use │ {OLD}" in turnscan("calibrations", "list").said
    assert f"Calibration {OLD}" in turnscan("calibrations", "show").said


def test_reconstruct_takes_the_one_in_use(store: CalibrationStore, small_recording: Path) -> None:
    truth = CalibrationRecord.load(small_recording / "truth.json")
    store.save(replace(truth, created=datetime(2025, 1, 1, tzinfo=UTC)))
    ended = turnscan("reconstruct", small_recording, "-o", "cloud.ply")
    assert ended.code == 0
    assert "2025-01-01T00-00-00Z" in ended.said


def test_a_removed_one_is_in_the_bin_until_it_is_used_again(store: CalibrationStore) -> None:
    said = turnscan("calibrations", "remove", NEW).said
    assert f"Removed: {NEW}" in said
    assert f"In use: {OLD}" in said
    listed = turnscan("calibrations", "list").said
    assert NEW not in listed
    assert "1 in the bin" in listed
    assert NEW in turnscan("calibrations", "list", "--removed").said
    assert turnscan("calibrations", "use", NEW).code == 0
    assert f"in use │ {NEW}" in turnscan("calibrations", "list").said


def test_two_are_compared_in_words_and_for_programs(
    store: CalibrationStore, capsys: pytest.CaptureFixture[str]
) -> None:
    said = turnscan("calibrations", "compare", OLD).said
    assert f"From {OLD} to {NEW}" in said
    assert "Laser left turned by 0.0000 degrees, -0.500 mm at the axis" in said
    assert "table +1.000 mm higher" in said
    assert "more than the two calibrations' own uncertainty (0.028 mm)" in said
    change = on_standard_output(capsys, "calibrations", "compare", OLD, NEW, "--json")
    assert change["axis"]["table_mm"] == pytest.approx(1.0)
    assert change["ball"]["right"]["moved_mm"] == pytest.approx(1.0, abs=0.02)
    same = turnscan("calibrations", "compare", "current", "current").said
    assert "no more than the two calibrations' own uncertainty" in same


def test_a_calibration_of_horus_is_kept_with_what_it_does_not_know(
    store: CalibrationStore, tmp_path: Path
) -> None:
    ended = turnscan("calibrations", "import", horus_file(tmp_path / "horus.json"), "--rotation", 90)
    assert ended.code == 0
    assert "For pictures of 1280 x 720: rotation = 90" in ended.said
    assert "The plane of laser 'right' is not in the file" in ended.said
    assert "Not enough for a scan: it has no axis" in ended.said
    assert "Not in use. To change that: turnscan calibrations use" in ended.said
    assert len(store.paths()) == 3
    assert f"Calibration {NEW}" in turnscan("calibrations", "show").said


def test_how_pictures_are_turned_is_taken_from_the_bench_file(
    store: CalibrationStore, tmp_path: Path
) -> None:
    path = horus_file(tmp_path / "horus.json")
    assert "For pictures of 720 x 1280: rotation = 0" in turnscan("calibrations", "show", path).said
    (tmp_path / "bench.toml").write_text(
        '[turntable]\ndriver = "manual"\n[camera]\ndriver = "uvc"\nrotation = 270\nmirror = true\n'
    )
    assert "rotation = 270 and mirror = true" in turnscan("calibrations", "show", path).said
    asked = turnscan("calibrations", "import", path, "--rotation", 90, "--no-mirror", "--use")
    assert "rotation = 90 and mirror = false" in asked.said
    assert store.current().camera.size == (1280, 720)


def test_a_calibration_of_this_program_is_kept_once(store: CalibrationStore, tmp_path: Path) -> None:
    assert turnscan("calibrations", "export", OLD, "-o", tmp_path / "rig.json").code == 0
    assert (tmp_path / "rig.json").read_bytes() == store.find(OLD).read_bytes()
    ended = turnscan("calibrations", "import", tmp_path / "rig.json", "--use")
    assert f"Was there already as {OLD}" in ended.said
    assert f"In use: {OLD}" in ended.said
    assert len(store.paths()) == 2


def test_opencv_reads_what_is_exported_for_it(store: CalibrationStore, tmp_path: Path) -> None:
    assert turnscan("calibrations", "export", "-o", tmp_path / "rig.yml").code == 0
    storage = cv2.FileStorage(str(tmp_path / "rig.yml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), RIG.camera.matrix)
    storage.release()


def test_show_writes_the_file_for_programs(
    store: CalibrationStore, capsys: pytest.CaptureFixture[str]
) -> None:
    assert on_standard_output(capsys, "calibrations", "show", "--json") == json.loads(
        store.find(NEW).read_text()
    )


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("show", "2030"), "holds no calibration '2030'"),
        (("use", "2026"), "holds 2 calibrations that begin with '2026'"),
        (("remove", "../calibration_store/x"), "holds no calibration"),
        (("import", "none.json"), "none.json: no such file"),
        (("import", "broken.json"), "calibration_settings.camera_matrix: is missing"),
        (("export", "-o", "rig.txt"), "a calibration is written as .json, .yml, .yaml or .xml"),
        (("compare", "portrait.json"), "is for pictures of 1280 x 720, and the other for 720 x 1280"),
    ],
)
def test_a_mistake_is_named_and_changes_nothing(
    arguments: tuple[str, ...], problem: str, store: CalibrationStore, tmp_path: Path
) -> None:
    horus = horus_file(tmp_path / "broken.json")
    document = json.loads(horus.read_text())
    del document["calibration_settings"]["camera_matrix"]
    horus.write_text(json.dumps(document))
    record(3, camera=standard_rig(720, 1280).rig.camera).save(tmp_path / "portrait.json")
    before = files_below(tmp_path)
    ended = turnscan("calibrations", *arguments)
    assert ended.code == 2
    assert problem in ended.sentence
    assert files_below(tmp_path) == before


def test_a_choice_that_has_gone_is_told_with_the_list(store: CalibrationStore) -> None:
    store.find(NEW).unlink()
    ended = turnscan("calibrations", "list")
    assert ended.code == 2
    assert OLD in ended.said
    assert f"names {NEW}.json, which is not there" in ended.sentence
    assert turnscan("calibrations", "use", OLD).code == 0


def test_an_empty_store_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ended = turnscan("calibrations", "list")
    assert ended.code == 0
    assert "holds no calibration yet" in ended.said
    assert not files_below(tmp_path)


def test_the_commands_of_the_group_explain_themselves(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["calibrations"]) == 0
    assert "compare" in capsys.readouterr().out
    assert run(["calibrations", "compare", "--help"]) == 0
    assert "--json" in capsys.readouterr().out


def test_a_scan_is_told_why_the_one_in_use_is_not_used(
    store: CalibrationStore, capsys: pytest.CaptureFixture[str]
) -> None:
    with Bench.build(a_bench()) as bench:
        assert calibration_for(bench, None) is not None
        (store.folder / "current").write_text("gone.json")
        assert calibration_for(bench, None) is None
    assert "names gone.json, which is not there" in " ".join(capsys.readouterr().err.split())


def test_a_scan_without_any_calibration_is_no_cause_for_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with Bench.build(a_bench()) as bench:
        assert calibration_for(bench, None) is None
    assert not capsys.readouterr().err


def a_bench() -> BenchDescription:
    return parse_bench(b'[turntable]\ndriver = "manual"\n[camera]\ndriver = "uvc"\n', "bench.toml")
