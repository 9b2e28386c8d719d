"""`turnscan calibrate --bench` as a person uses it."""

import json
from pathlib import Path

import pytest
from command_line import Ended, turnscan

from app.calibration.capture import Captured
from app.calibration.proof import Proof, ProofFinding, Verdict
from app.calibration.record import CalibrationRecord
from app.recording.reader import Recording
from app.simulation.rig import standard_rig
from benchmarks.bench_text import simulated_bench

_BENCH = simulated_bench({"dialect": "horus", "width": 480, "height": 360, "rate": 16.0})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a bench, and of the true camera in a file."""
    path = tmp_path_factory.mktemp("bench")
    (path / "bench.toml").write_text(_BENCH)
    CalibrationRecord(camera=standard_rig(480, 360).rig.camera).save(path / "camera.json")
    return path


@pytest.fixture(scope="module")
def calibrated(folder: Path) -> Ended:
    """With a known camera, which saves the time of its views."""
    return turnscan(
        "calibrate", "--bench", folder / "bench.toml", folder / "pictures", "-o", folder / "rig.json",
        "--camera", folder / "camera.json",
    )  # fmt: skip


def test_one_command_takes_the_pictures_calibrates_and_proves_it(folder: Path, calibrated: Ended) -> None:
    assert calibrated.code == 0, calibrated.said
    assert "new angles" in calibrated.said
    record = CalibrationRecord.load(folder / "rig.json")
    assert set(record.lasers) == {"left", "right"}
    assert record.extra["proof"]["verdict"] in ("good", "fair")
    page = (folder / "rig.html").read_text()
    assert "Proof, good" in page


def test_the_empty_table_shows_how_high_it_is(folder: Path, calibrated: Ended) -> None:
    assert calibrated.code == 0, calibrated.said
    axis, true = CalibrationRecord.load(folder / "rig.json").rig.axis, standard_rig(480, 360).rig.axis
    assert abs(float((axis.origin - true.origin) @ true.direction)) < 0.5


def test_the_pictures_stay_and_calibrate_again(folder: Path, calibrated: Ended) -> None:
    assert calibrated.code == 0, calibrated.said
    assert len(Recording.open(folder / "pictures").entries) >= 30 + 24
    assert len(Recording.open(folder / "pictures" / "proof").entries) >= 12
    again = turnscan("calibrate", folder / "pictures", "--intrinsics", folder / "camera.json",
                     "-o", folder / "again.json")  # fmt: skip
    assert again.code in (0, 1), again.said
    assert json.loads((folder / "again.json").read_text())["method"] == "joint"


def test_a_calibration_whose_proof_is_bad_is_kept_and_not_trusted(
    folder: Path, calibrated: Ended, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert calibrated.code == 0, calibrated.said
    pictures = Recording.open(folder / "pictures")
    lost = Captured(pictures, Recording.open(pictures.folder / "proof"))
    finding = ProofFinding(
        "turning", 0.9, Verdict.BAD, "It turns too far.", "The steps are wrong", "look at them", 0.1, 0.3
    )
    monkeypatch.setattr("app.cli.calibrate_bench.capture", lambda *args, **options: lost)
    monkeypatch.setattr("app.jobs.calibrate_solve.prove", lambda *args: Proof((finding,), 5, 100))
    outcome = turnscan(
        "calibrate", "--bench", folder / "bench.toml", tmp_path / "pictures", "-o", tmp_path / "rig.json",
        "--camera", folder / "camera.json",
    )  # fmt: skip
    assert outcome.code == 1, outcome.said
    assert "Do not trust this result: It turns too far. The steps are wrong: look at them." in outcome.said
    assert CalibrationRecord.load(tmp_path / "rig.json").extra["proof"]["verdict"] == "bad"


def test_the_pictures_of_another_calibration_are_not_written_over(folder: Path, calibrated: Ended) -> None:
    again = turnscan("calibrate", "--bench", folder / "bench.toml", folder / "pictures", "--camera",
                     folder / "camera.json")  # fmt: skip
    assert again.code == 2
    assert "is not empty" in again.sentence


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "Nothing is named to calibrate from"),
        (["--board", "chessboard:9x6:10"], "only go with --bench"),
        (["--camera", "camera.json"], "only go with --bench"),
        (["--resume"], "only go with --bench"),
        (["--bench", "simulated", "--method", "paper"], "joint method"),
        (["--bench", "simulated", "--resume"], "needs the folder"),
        (["--bench", "simulated", "one", "two"], "one folder"),
        (["--bench", "simulated", "--board", "chess"], "does not describe a board"),
        (["--bench", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    arguments: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = turnscan("calibrate", *arguments)
    assert outcome.code == 2
    assert sentence in outcome.sentence
    assert not list(tmp_path.iterdir())


def test_a_real_bench_must_name_its_board(tmp_path: Path) -> None:
    text = _BENCH.split("[simulation]", maxsplit=1)[0].replace('driver = "simulated"', 'driver = "manual"', 1)
    (tmp_path / "bench.toml").write_text(
        text.replace('driver = "simulated"', 'driver = "folder"\nfolder = "nothing"')
    )
    outcome = turnscan("calibrate", "--bench", tmp_path / "bench.toml", tmp_path / "pictures")
    assert outcome.code == 2
    assert "names no calibration board" in outcome.sentence
    assert "--board chessboard:11x8:12" in outcome.sentence
