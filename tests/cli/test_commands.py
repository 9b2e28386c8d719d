"""Every command does what its help says."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import copied, files_below, rewritten, turnscan

from app.calibration.record import CalibrationRecord
from app.cli.main import run
from app.recording.reader import Recording
from app.surface.ply_reader import read_ply

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def calibrated(small_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Calibration file of the small recording, its report beside it."""
    path = tmp_path_factory.mktemp("calibrated") / "rig.json"
    ended = turnscan("calibrate", small_recording, "-o", path)
    assert ended.code == 0
    assert "Expected error" in ended.said
    return path


@pytest.mark.parametrize(
    "board",
    [
        "chessboard:9x6:20",
        "charuco:7x5:25:18:DICT_4X4_50",
        "circles:7x6:15",
        "asymmetric_circles:4x11:12",
    ],
)
@pytest.mark.parametrize(("ending", "start"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_board_is_printed(board: str, ending: str, start: bytes, tmp_path: Path) -> None:
    ended = turnscan("board", board, "-o", tmp_path / f"board.{ending}", "--paper", "letter")
    assert ended.code == 0
    assert (tmp_path / f"board.{ending}").read_bytes().startswith(start)
    assert "100 mm" in ended.said


@pytest.mark.parametrize(("ending", "start"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_platter_is_printed(ending: str, start: bytes, tmp_path: Path) -> None:
    out = tmp_path / f"platter.{ending}"
    assert turnscan("platter", "DICT_4X4_50:18:0,1,2", "--diameter", 150, "-o", out).code == 0
    assert out.read_bytes().startswith(start)


def test_a_simulation_is_a_recording_with_the_truth_beside_it(tmp_path: Path) -> None:
    out = tmp_path / "r"
    ended = turnscan(
        "simulate", out, "--object", "cube", "--width", 320, "--height", 240, "--steps", 2,
        "--parts", "scan", "--jpeg", 90, "--direction", "cw",
    )  # fmt: skip
    assert ended.code == 0
    recording = Recording.open(out)
    assert recording.direction == "cw"
    assert recording.entries[0].file.endswith(".jpg")
    assert CalibrationRecord.load(out / "truth.json").method == "truth"


def test_a_calibration_has_a_report(calibrated: Path) -> None:
    record = CalibrationRecord.load(calibrated)
    assert set(record.lasers) == {"left", "right"}
    assert record.method == "joint"
    assert record.axis is not None
    assert record.expected_error_mm < 0.05
    assert "Calibration report" in calibrated.with_suffix(".html").read_text()


def test_the_report_may_be_a_picture(small_recording: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "rig.json", tmp_path / "report.png"
    ended = turnscan("calibrate", small_recording, "-o", out, "--method", "paper", "--report", report)
    assert ended.code in (0, 1)
    assert report.read_bytes().startswith(PNG)
    assert CalibrationRecord.load(out).method == "paper"


def test_a_known_camera_is_taken_as_it_is(small_recording: Path, tmp_path: Path) -> None:
    truth = small_recording / "truth.json"
    out = tmp_path / "rig.json"
    ended = turnscan(
        "calibrate", small_recording, "-o", out, "--method", "paper", "--axis", "board",
        "--intrinsics", truth,
    )  # fmt: skip
    assert ended.code == 0
    np.testing.assert_array_equal(
        CalibrationRecord.load(out).camera.matrix, CalibrationRecord.load(truth).camera.matrix
    )


def test_a_cloud_is_written_with_its_picture(small_recording: Path, calibrated: Path, tmp_path: Path) -> None:
    ended = turnscan("reconstruct", small_recording, "-c", calibrated, "-o", tmp_path / "ball.ply")
    assert ended.code == 0
    assert "Table angle from commanded angle, 12 stops" in ended.said
    assert len(read_ply(tmp_path / "ball.ply")) > 2000
    assert (tmp_path / "ball.png").read_bytes().startswith(PNG)
    assert files_below(tmp_path) == {"ball.ply", "ball.png"}


def test_text_and_binary_hold_the_same_points(
    small_recording: Path, calibrated: Path, tmp_path: Path
) -> None:
    for name, options in (("b.ply", []), ("t.ply", ["--ascii"])):
        command = ["reconstruct", small_recording, "-c", calibrated, "-o", tmp_path / name, *options]
        assert turnscan(*command, "--preview", tmp_path / "p.png").code == 0
    assert b"format ascii" in (tmp_path / "t.ply").read_bytes()[:200]
    assert b"format binary_little_endian" in (tmp_path / "b.ply").read_bytes()[:200]
    binary, text = read_ply(tmp_path / "b.ply"), read_ply(tmp_path / "t.ply")
    np.testing.assert_allclose(text.points, binary.points, atol=1e-3)
    np.testing.assert_array_equal(text.colours, binary.colours)


def test_standard_output_carries_the_cloud_and_nothing_else(
    small_recording: Path,
    calibrated: Path,
    tmp_path: Path,
    capfdbinary: pytest.CaptureFixture[bytes],
) -> None:
    code = run(["reconstruct", str(small_recording), "-c", str(calibrated), "-o", "-"])
    out, said = capfdbinary.readouterr()
    assert code == 0
    assert b"Points" in said
    (tmp_path / "stream.ply").write_bytes(out)
    assert out.startswith(b"ply\n")
    assert turnscan("reconstruct", small_recording, "-c", calibrated, "-o", tmp_path / "file.ply").code == 0
    streamed, written = read_ply(tmp_path / "stream.ply"), read_ply(tmp_path / "file.ply")
    np.testing.assert_array_equal(streamed.points, written.points)


def test_points_outside_the_region_are_left_out(
    small_recording: Path, calibrated: Path, tmp_path: Path
) -> None:
    out = tmp_path / "top.ply"
    ended = turnscan(
        "reconstruct", small_recording, "-c", calibrated, "-o", out,
        "--radius", 25, "--min-quality", 0.2, "--no-markers",
    )  # fmt: skip
    assert ended.code == 0
    points = read_ply(out).points
    assert np.hypot(points[:, 0], points[:, 1]).max() <= 25.0
    assert "left out: not in the region" in ended.said


def test_pictures_of_a_folder_are_imported(small_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "imported"
    ended = turnscan(
        "import", small_recording / "frames", out, "--role", "scan", "--laser", "left:red",
        "--pattern", "left", "--step", 5, "--direction", "ccw",
    )  # fmt: skip
    assert ended.code == 0
    recording = Recording.open(out)
    assert len(recording.entries) == len(list((small_recording / "frames").iterdir()))
    assert recording.entries[2].angle_deg == 10.0


def test_the_demo_goes_from_pictures_to_a_cloud(small_recording: Path, tmp_path: Path) -> None:
    copied(small_recording, tmp_path / "out" / "sphere-12")
    ended = turnscan("demo", tmp_path / "out", "--object", "sphere", "--steps", 12)
    assert ended.code == 0
    assert {"calibration.json", "calibration.html", "sphere.ply", "sphere.png"} <= files_below(
        tmp_path / "out"
    )
    assert "sphere.png" in ended.said


def test_a_result_that_must_not_be_trusted_ends_with_one(small_recording: Path, tmp_path: Path) -> None:
    copy = copied(small_recording, tmp_path / "r")
    rewritten(
        copy,
        lambda document: document.update(
            frames=[
                frame
                for k, frame in enumerate(document["frames"])
                if frame["role"] == "axis" or (frame["role"] == "intrinsics" and k < 3)
            ]
        ),
    )
    ended = turnscan("calibrate", copy, "-o", tmp_path / "rig.json")
    assert ended.code == 1
    assert "Do not trust this result" in ended.said
    assert (tmp_path / "rig.json").is_file()


def test_a_table_that_was_moved_since_ends_with_one(small_recording: Path, tmp_path: Path) -> None:
    document = json.loads((small_recording / "truth.json").read_text())
    document["table"]["offset_mm"] -= 4.0
    (tmp_path / "rig.json").write_text(json.dumps(document))
    ended = turnscan("reconstruct", small_recording, "-c", tmp_path / "rig.json", "-o", tmp_path / "b.ply")
    assert ended.code == 1
    assert "calibrate again" in ended.said
    assert (tmp_path / "b.ply").is_file()


@pytest.mark.parametrize("command", ["import", "board", "calibrate", "reconstruct", "simulate", "demo"])
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command, "--help"]) == 0
    assert "Usage" in capsys.readouterr().out


def test_calibrations_are_kept_under_their_date_and_the_newest_is_used(
    small_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert turnscan("calibrate", small_recording).code == 0
    (kept,) = (tmp_path / "calibration_store").glob("*.json")
    assert kept.with_suffix(".html").is_file()
    ended = turnscan("reconstruct", small_recording, "-o", "cloud.ply")
    assert ended.code == 0
    assert kept.name in ended.said
    assert len(read_ply(tmp_path / "cloud.ply")) > 0


def test_an_empty_store_says_what_to_do(
    small_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = turnscan("reconstruct", small_recording, "-o", "cloud.ply")
    assert ended.code == 2
    assert "turnscan calibrate" in ended.said
    assert not list(tmp_path.iterdir())
