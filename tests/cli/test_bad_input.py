"""Whatever is wrong with what a command is given: one sentence that names it, what to do, nothing written."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command_line import Ended, copied, files_below, frame_of, replaced, rewritten, turnscan

Damage = Callable[[Path], None]


@pytest.fixture
def recording(small_recording: Path, tmp_path: Path) -> Path:
    """A copy that may be damaged."""
    return copied(small_recording, tmp_path / "recording")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """An empty folder for results."""
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def calibrate(recording: Path, out: Path, *options: object) -> Ended:
    return turnscan("calibrate", recording, "-o", out / "rig.json", *options)


def reconstruct(recording: Path, out: Path, *options: object) -> Ended:
    truth = recording / "truth.json"
    return turnscan("reconstruct", recording, "-c", truth, "-o", out / "cloud.ply", *options)


def assert_refused(ended: Ended, out: Path, *named: str) -> None:
    assert ended.code == 2
    for name in named:
        assert name in ended.sentence
    assert "Traceback" not in ended.said
    # The sentence, and after it what to do.
    assert ended.sentence.count(". ") >= 1 or ended.sentence.endswith("."), ended.sentence
    assert files_below(out) == set()


def missing(picture: Path) -> None:
    picture.unlink()


def truncated(picture: Path) -> None:
    replaced(picture, picture.read_bytes()[:2000])


def undecodable(picture: Path) -> None:
    replaced(picture, b"this is no picture" * 50)


def empty(picture: Path) -> None:
    replaced(picture, b"")


def of_wrong_size(picture: Path) -> None:
    encoded = cv2.imencode(".png", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    replaced(picture, encoded)


DAMAGES = [missing, truncated, undecodable, empty, of_wrong_size]


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(("command", "role"), [(calibrate, "laser_plane"), (reconstruct, "scan")])
def test_a_picture_that_cannot_be_used_is_named(
    damage: Damage, command: Callable[[Path, Path], Ended], role: str, recording: Path, out: Path
) -> None:
    picture = frame_of(recording, role)
    damage(picture)
    assert_refused(command(recording, out), out, picture.name)


@pytest.mark.parametrize(("command", "role"), [(calibrate, "axis"), (reconstruct, "scan")])
def test_a_picture_that_cannot_be_used_may_be_passed_over(
    command: Callable[..., Ended], role: str, recording: Path, out: Path
) -> None:
    picture = frame_of(recording, role)
    truncated(picture)
    ended = command(recording, out, "--skip-bad-frames")
    assert ended.code == 0
    assert picture.name in ended.said


def first_frame(**entries: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document["frames"][0].update(entries)


def top(**entries: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document.update(entries)


MANIFESTS = [
    (first_frame(role="portrait"), "role"),
    (first_frame(file="../outside.png"), "leaves the folder"),
    (first_frame(file="/etc/hostname"), "leaves the folder"),
    (first_frame(file=""), "file"),
    (first_frame(lasers_on=["blue one"]), "blue one"),
    (first_frame(angle_deg=float("nan")), "angle_deg: must be a finite number"),
    (top(camera={"width": -640, "height": 480}), "width"),
    (top(camera={"width": float("nan"), "height": 480}), "width: must be a finite number"),
    (top(camera={"width": 640}), "height"),
    (top(board={"kind": "chessboard", "columns": 9, "rows": 6, "square_mm": -7.5}), "square_mm"),
    (top(board={"kind": "chessboard", "columns": -9, "rows": 6, "square_mm": 7.5}), "columns"),
    (top(board={"kind": "tiles", "columns": 9, "rows": 6, "square_mm": 7.5}), "kind"),
    (top(version=2), "version"),
    (top(format="holiday-pictures"), "format"),
    (top(turntable={"direction": "left"}), "direction"),
    (top(frames="none"), "frames"),
]


@pytest.mark.parametrize(("change", "named"), MANIFESTS)
@pytest.mark.parametrize("command", [calibrate, reconstruct])
def test_a_manifest_with_a_mistake_names_the_entry(
    change: Callable[[dict[str, Any]], None],
    named: str,
    command: Callable[[Path, Path], Ended],
    recording: Path,
    out: Path,
) -> None:
    rewritten(recording, change)
    assert_refused(command(recording, out), out, "recording.json", named)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "\x00\x01", '{"format": ' * 2000])
def test_a_manifest_that_is_no_json_is_named(text: str, recording: Path, out: Path) -> None:
    replaced(recording / "recording.json", text.encode())
    assert_refused(reconstruct(recording, out), out, "recording.json")


def test_a_folder_that_is_no_recording_is_named(tmp_path: Path, out: Path) -> None:
    assert_refused(calibrate(tmp_path / "nothing here", out), out, "nothing here")
    assert_refused(calibrate(out, out), out, "recording.json")


def test_a_board_that_is_never_seen_is_named(recording: Path, out: Path) -> None:
    frames = ("laser_plane", "intrinsics", "axis", "axis_line")
    grey = cv2.imencode(".png", np.full((480, 640, 3), 90, np.uint8))[1].tobytes()
    for entry in json.loads((recording / "recording.json").read_text())["frames"]:
        if entry["role"] in frames:
            replaced(recording / entry["file"], grey)
    assert_refused(calibrate(recording, out), out, "board was never seen", "columns and rows")


def test_a_board_of_other_counts_is_as_good_as_none(recording: Path, out: Path) -> None:
    board = {"kind": "chessboard", "columns": 12, "rows": 10, "square_mm": 7.5}
    rewritten(recording, lambda document: document.update(board=board))
    assert_refused(calibrate(recording, out), out, "board", "recording.json")


def darkened(recording: Path, roles: tuple[str, ...], laser: str = "") -> None:
    """Show the picture without a laser in place of those with one."""
    grey = cv2.imencode(".png", np.full((480, 640, 3), 40, np.uint8))[1].tobytes()
    dark = grey
    for entry in json.loads((recording / "recording.json").read_text())["frames"]:
        if entry["role"] not in roles:
            continue
        lit = entry.get("lasers_on") or []
        if not lit:
            dark = (recording / entry["file"]).read_bytes()
        elif not laser or laser in lit:
            replaced(recording / entry["file"], dark)


def test_a_laser_that_is_never_seen_on_the_board_is_named(recording: Path, out: Path) -> None:
    darkened(recording, ("laser_plane", "axis", "axis_line"))
    assert_refused(calibrate(recording, out), out, "laser 'left' was not seen", "colour")


def test_one_laser_of_two_that_is_never_seen_on_the_board_is_told(recording: Path, out: Path) -> None:
    darkened(recording, ("laser_plane", "axis", "axis_line"), "right")
    ended = calibrate(recording, out)
    assert ended.code in (0, 1)
    assert "Laser 'right' has no plane" in ended.said
    assert set(json.loads((out / "rig.json").read_text())["lasers"]) == {"left"}


def test_a_laser_that_is_never_seen_in_a_scan_is_named(recording: Path, out: Path) -> None:
    grey = cv2.imencode(".png", np.full((480, 640, 3), 40, np.uint8))[1].tobytes()
    for entry in json.loads((recording / "recording.json").read_text())["frames"]:
        if entry["role"] in ("scan", "texture") and entry.get("lasers_on") != ["left"]:
            replaced(recording / entry["file"], grey)
    assert_refused(reconstruct(recording, out), out, "'right'")


def with_calibration(recording: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = recording / "truth.json"
    document = json.loads(path.read_text())
    change(document)
    replaced(path, json.dumps(document).encode())


CALIBRATIONS: list[tuple[Callable[[dict[str, Any]], None], tuple[str, ...]]] = [
    (lambda d: d["camera"].update(width=1280, height=720), ("1280", "640")),
    (lambda d: d["lasers"].pop("right"), ("'right'",)),
    (lambda d: d.update(lasers={}), ("laser",)),
    (lambda d: d.pop("axis"), ("axis",)),
    (lambda d: d["axis"].update(direction=[0.0, 0.0, 0.0]), ("axis.direction",)),
    (lambda d: d["camera"].update(matrix=[[float("nan"), 0, 0], [0, 1, 0], [0, 0, 1]]), ("camera.matrix",)),
    (lambda d: d["camera"].update(width=-640), ("camera.width",)),
    (lambda d: d.update(platter={"corners_mm": {"x": [1]}}), ("platter",)),
    (lambda d: d.update(format="other"), ("format",)),
]


@pytest.mark.parametrize(("change", "named"), CALIBRATIONS)
def test_a_calibration_that_does_not_fit_is_named(
    change: Callable[[dict[str, Any]], None], named: tuple[str, ...], recording: Path, out: Path
) -> None:
    with_calibration(recording, change)
    assert_refused(reconstruct(recording, out), out, *named)


def test_a_camera_for_other_pictures_is_refused(recording: Path, out: Path) -> None:
    with_calibration(recording, lambda d: d["camera"].update(width=1280, height=720))
    ended = calibrate(recording, out, "--intrinsics", recording / "truth.json")
    assert_refused(ended, out, "1280x720", "640x480")


def test_recordings_of_two_rigs_are_not_mixed(small_recording: Path, tmp_path: Path, out: Path) -> None:
    other = copied(small_recording, tmp_path / "other")
    rewritten(other, lambda document: document["camera"].update(width=320, height=240))
    ended = turnscan("calibrate", small_recording, other, "-o", out / "rig.json")
    assert_refused(ended, out, "not of one rig", "picture size")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["reconstruct", "{r}", "-c", "{r}/truth.json", "-o", "{out}/cloud.txt"], "cloud.txt"),
        (["reconstruct", "{r}", "-c", "{out}/none.json", "-o", "{out}/c.ply"], "none.json"),
        (["reconstruct", "{r}", "-c", "{r}/truth.json", "-o", "{out}/no/c.ply"], "no"),
        (["reconstruct", "{r}", "-c", "{r}/truth.json", "-o", "{out}/c.ply", "--detector", "x"], "'x'"),
        (["reconstruct", "{r}", "-c", "{r}/truth.json", "-o", "{out}/c.ply", "--radius", "-5"], "-5"),
        (["reconstruct", "{r}", "-c", "{r}/truth.json", "-o", "{out}/c.ply", "--radius", "nan"], "nan"),
        (
            [
                "reconstruct",
                "{r}",
                "-c",
                "{r}/truth.json",
                "-o",
                "{out}/c.ply",
                "--above",
                "99",
                "--below",
                "9",
            ],
            "99",
        ),
        (["calibrate", "{r}", "-o", "{out}/no/rig.json"], "no"),
        (["calibrate", "{r}", "-o", "{out}/rig.json", "--report", "{out}/r.txt"], "r.txt"),
        (["calibrate", "{r}", "-o", "{out}/rig.json", "--axis", "board"], "--axis"),
        (["calibrate", "{r}", "-o", "{out}/rig.json", "--no-distortion"], "--no-distortion"),
        (["board", "chessboard:9x6", "-o", "{out}/b.pdf"], "chessboard:9x6"),
        (["board", "chessboard:9x6:nan", "-o", "{out}/b.pdf"], "nan"),
        (["board", "chessboard:90x60:20", "-o", "{out}/b.pdf"], "does not fit"),
        (["board", "charuco:7x5:20:18:DICT_9X9", "-o", "{out}/b.pdf"], "DICT_9X9"),
        (["board", "chessboard:9x6:20", "-o", "{out}/b.doc"], "b.doc"),
        (["platter", "DICT_4X4_50:20:0,99", "-o", "{out}/b.pdf"], "99"),
        (["platter", "markers", "-o", "{out}/b.pdf"], "markers"),
        (["simulate", "{out}/s", "--object", "unicorn"], "unicorn"),
        (["simulate", "{r}", "--steps", "2"], "recording"),
        (["simulate", "{out}/s", "--laser", "third"], "third"),
        (["import", "{out}/nothing", "{out}/r", "--laser", "left:red"], "nothing"),
        (["import", "{out}", "{out}/r", "--laser", "left:red"], "out"),
        (["import", "{r}/frames", "{out}/r"], "laser"),
    ],
)
def test_an_option_that_cannot_work_is_named(
    arguments: list[str], named: str, small_recording: Path, out: Path
) -> None:
    filled = [text.format(r=small_recording, out=out) for text in arguments]
    assert_refused(turnscan(*filled), out, named)


@pytest.mark.parametrize("arguments", [["fly"], ["calibrate"], ["board", "--paper", "a3"], ["--what"]])
def test_a_command_that_does_not_exist_ends_with_two(arguments: list[str]) -> None:
    assert turnscan(*arguments).code == 2
