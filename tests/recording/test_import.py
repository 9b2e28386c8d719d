"""Pictures somebody took become a recording."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.errors import ImportFailed, OptionError, OutputError, RecordingError
from app.recording.import_frames import import_pictures
from app.recording.import_plan import ImportPlan, lay_out
from app.recording.picture import encode
from app.recording.picture_folder import natural
from app.recording.reader import Recording
from app.recording.shot import Role
from app.recording.video import Video
from app.vision.board import BoardSpec
from app.vision.stripe import Image

GREEN = ImportPlan(lasers={"green": "green"}, step_deg=10.0)
BOTH = {"left": "red", "right": "red"}


def picture(level: int, size: tuple[int, int] = (32, 24)) -> Image:
    return np.full((size[1], size[0], 3), level, np.uint8)


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Twelve pictures whose names sort differently as text."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(12):
        (folder / f"shot{number}.jpg").write_bytes(encode(picture(number * 20), "jpeg"))
    (folder / "notes.txt").write_text("taken on a Tuesday")
    return folder


def levels(recording: Recording) -> list[int]:
    return [round(float(shot.image.mean()) / 20.0) for shot in recording.shots()]


def angles(recording: Recording) -> list[float | None]:
    return [entry.angle_deg for entry in recording.entries]


def spin(path: Path, turns: float, frames_per_turn: float, repeat: int = 1) -> None:
    """A video of something that turns, each picture `repeat` times."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    rows = np.arange(48)[:, None] / 48.0
    for number in range(round(turns * frames_per_turn)):
        angle = 2.0 * np.pi * number / frames_per_turn
        centre = 32 + 14 * np.sin(angle + 4.0 * rows) + 6 * np.cos(2 * angle + rows)
        stripe = 220.0 * np.exp(-(((np.arange(64)[None] - centre) / 4.0) ** 2))
        for _ in range(repeat):
            writer.write(np.repeat(stripe[..., None], 3, axis=2).astype(np.uint8))
    writer.release()


def test_names_are_ordered_as_people_count() -> None:
    names = ["img10.png", "img2.png", "IMG1.png", "a.png", "img2b.png"]
    assert sorted(names, key=natural) == ["a.png", "IMG1.png", "img2.png", "img2b.png", "img10.png"]


def test_a_folder_becomes_a_scan_byte_for_byte(pictures: Path, tmp_path: Path) -> None:
    report = import_pictures(pictures, tmp_path / "rec", GREEN)
    there = Recording.open(tmp_path / "rec")
    assert levels(there) == list(range(12))
    assert angles(there) == [10.0 * number for number in range(12)]
    assert there.entries[3].lasers_on == ("green",)
    assert there.read_bytes(there.entries[3]) == (pictures / "shot3.jpg").read_bytes()
    assert (report.written, report.skipped, report.step_deg) == (12, (), 10.0)


def test_the_order_of_time_is_that_of_the_files(pictures: Path, tmp_path: Path) -> None:
    for number in range(12):
        os.utime(pictures / f"shot{number}.jpg", (1000 - number, 1000 - number))
    plan = ImportPlan(lasers={"green": "green"}, turns=1.0, order="time")
    there = import_pictures(pictures, tmp_path / "rec", plan).recording
    assert levels(there) == list(range(11, -1, -1))
    assert angles(there) == [30.0 * number for number in range(12)]


def test_pictures_that_cannot_be_used_are_named_and_keep_their_place(pictures: Path, tmp_path: Path) -> None:
    (pictures / "shot3.jpg").write_bytes(b"")
    (pictures / "shot5.jpg").write_bytes((pictures / "shot5.jpg").read_bytes()[:-40])
    (pictures / "shot7.jpg").write_bytes(encode(picture(0, (40, 24)), "jpeg"))
    report = import_pictures(pictures, tmp_path / "rec", GREEN)
    assert [str(skipped) for skipped in report.skipped] == [
        "shot3.jpg is empty",
        "shot5.jpg is truncated",
        "shot7.jpg is 40 x 24 pixels, not 32 x 24 as the others",
    ]
    assert angles(report.recording) == [10.0 * number for number in (0, 1, 2, 4, 6, 8, 9, 10, 11)]
    assert "3 pictures could not be used." in report.sentences()


def test_pictures_of_one_stop_cycle_through_the_lasers(pictures: Path, tmp_path: Path) -> None:
    plan = ImportPlan(lasers={"left": "red", "right": "red"}, pattern=(("left",), ("right",), ()), turns=1.0)
    entries = import_pictures(pictures, tmp_path / "rec", plan).recording.entries
    assert [entry.lasers_on for entry in entries[:4]] == [("left",), ("right",), (), ("left",)]
    assert [entry.role for entry in entries[:3]] == [Role.SCAN, Role.SCAN, Role.TEXTURE]
    assert [entry.angle_deg for entry in entries[::3]] == [0.0, 90.0, 180.0, 270.0]
    assert entries[2].angle_deg == 0.0


def test_several_folders_make_one_recording(pictures: Path, tmp_path: Path) -> None:
    out, board = tmp_path / "rec", BoardSpec("chessboard", 8, 6, 40.0)
    import_pictures(pictures, out, ImportPlan(role=Role.INTRINSICS, board=board, every=4))
    planes = ImportPlan(role=Role.LASER_PLANE, lasers={"left": "red"}, pattern=(("left",), ()))
    import_pictures(pictures, out, planes, is_added=True)
    import_pictures(pictures, out, planes, is_added=True)
    scan = ImportPlan(lasers={"left": "red", "right": "red"}, turns=1.0, direction="cw")
    there = import_pictures(pictures, out, scan, is_added=True).recording
    assert [len(there.select(role)) for role in (Role.INTRINSICS, Role.LASER_PLANE, Role.SCAN)] == [3, 24, 12]
    poses = [entry.pose for entry in there.select(Role.LASER_PLANE)]
    assert poses == [number // 2 for number in range(24)]
    assert (dict(there.lasers), there.board, there.direction) == (BOTH, board, "cw")


@pytest.mark.parametrize(
    ("plan", "problem"),
    [
        (ImportPlan(role=Role.INTRINSICS, board=BoardSpec("chessboard", 9, 6, 40.0)), "has another board"),
        (ImportPlan(role=Role.SCAN, lasers={"left": "green"}, step_deg=1.0), "'left' as a red laser"),
        (ImportPlan(lasers={"left": "red"}, step_deg=1.0, direction="cw"), "turns ccw, not cw"),
    ],
)
def test_what_contradicts_the_recording_is_not_added(
    pictures: Path, tmp_path: Path, plan: ImportPlan, problem: str
) -> None:
    first = ImportPlan(lasers={"left": "red"}, step_deg=3.0, board=BoardSpec("chessboard", 8, 6, 40.0))
    import_pictures(pictures, tmp_path / "rec", first)
    with pytest.raises(RecordingError, match=problem):
        import_pictures(pictures, tmp_path / "rec", plan, is_added=True)
    assert len(Recording.open(tmp_path / "rec").entries) == 12


def test_an_interrupted_import_leaves_nothing(pictures: Path, tmp_path: Path) -> None:
    def interrupt(done: int, total: int | None) -> None:
        if (tmp_path / "rec").exists() and done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_pictures(pictures, tmp_path / "rec", GREEN, progress=interrupt)
    assert not (tmp_path / "rec").exists()


def test_a_target_that_holds_something_is_refused_before_anything_is_read(
    pictures: Path, tmp_path: Path
) -> None:
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "thesis.txt").write_text("irreplaceable")
    looked_at: list[int] = []
    with pytest.raises(OutputError, match="is not empty"):
        import_pictures(
            pictures, tmp_path / "rec", GREEN, progress=lambda done, total: looked_at.append(done)
        )
    assert looked_at == []


@pytest.mark.parametrize(
    ("plan", "problem"),
    [
        (ImportPlan(lasers={"a": "red"}, step_deg=1.0, turns=1.0), "Only one of"),
        (ImportPlan(lasers={"a": "red"}, step_deg=-1.0), "step_deg must be greater than 0"),
        (ImportPlan(lasers={"a": "red"}, turns=float("nan")), "turns must be greater than 0"),
        (ImportPlan(step_deg=1.0), "need a laser"),
        (ImportPlan(lasers={"a": "red"}, pattern=(("b",),), step_deg=1.0), "'b', which is not among"),
        (ImportPlan(lasers={"a": "red"}, every=0, step_deg=1.0), "every must be 1 or more"),
        (ImportPlan(lasers={"a": "red"}, seconds_per_turn=9.0), "whose pictures have no times"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(
    pictures: Path, tmp_path: Path, plan: ImportPlan, problem: str
) -> None:
    with pytest.raises(OptionError, match=problem):
        import_pictures(pictures, tmp_path / "rec", plan)
    assert not (tmp_path / "rec").exists()


def test_sources_that_are_none_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "a.png").write_bytes(b"no picture")
    (tmp_path / "clip.mp4").write_bytes(b"no video" * 1000)
    for name, problem in (
        ("nowhere", "no such folder or video"),
        ("empty", "holds no picture"),
        ("bad", "not one of 1 pictures can be decoded"),
        ("clip.mp4", "not a video"),
    ):
        with pytest.raises(ImportFailed, match=problem):
            import_pictures(tmp_path / name, tmp_path / "rec", GREEN)


def test_a_video_tells_the_length_of_its_turn(tmp_path: Path) -> None:
    spin(tmp_path / "clip.avi", turns=2.6, frames_per_turn=41.5)
    report = import_pictures(
        tmp_path / "clip.avi", tmp_path / "rec", ImportPlan(lasers={"a": "any"}, start_deg=5)
    )
    assert report.turn is not None
    assert report.turn.frames == pytest.approx(41.5, abs=0.1)
    assert report.written == 108
    assert report.recording.entries[0].angle_deg == 5.0
    assert report.step_deg == pytest.approx(360.0 / 41.5, rel=3e-3)
    assert "One turn is 41.5" in " ".join(report.sentences())


def test_a_padded_video_loses_its_repetitions(tmp_path: Path) -> None:
    spin(tmp_path / "clip.avi", turns=2.0, frames_per_turn=30.0, repeat=4)
    report = import_pictures(tmp_path / "clip.avi", tmp_path / "rec", ImportPlan(lasers={"a": "any"}))
    assert (report.written, report.repeated) == (60, 180)
    assert report.stride == pytest.approx(4.0)
    assert report.step_deg == pytest.approx(12.0, rel=3e-3)


def test_a_video_that_shows_less_than_a_turn_asks_for_it(tmp_path: Path) -> None:
    spin(tmp_path / "clip.avi", turns=0.9, frames_per_turn=60.0)
    with pytest.raises(ImportFailed, match="does not repeat itself") as caught:
        import_pictures(tmp_path / "clip.avi", tmp_path / "rec", ImportPlan(lasers={"a": "any"}))
    assert "how many turns" in caught.value.hint
    told = ImportPlan(lasers={"a": "any"}, turns=0.9)
    report = import_pictures(tmp_path / "clip.avi", tmp_path / "rec", told)
    assert report.step_deg == pytest.approx(6.0)


def test_the_time_of_a_turn_gives_the_angles_of_a_video(tmp_path: Path) -> None:
    spin(tmp_path / "clip.avi", turns=0.5, frames_per_turn=60.0)
    plan = ImportPlan(lasers={"a": "any"}, seconds_per_turn=2.4, image_format="jpeg")
    there = import_pictures(tmp_path / "clip.avi", tmp_path / "rec", plan).recording
    assert there.entries[25].time_s == pytest.approx(1.0)
    assert there.entries[25].angle_deg == pytest.approx(150.0)
    assert there.entries[25].file.endswith(".jpg")


@pytest.mark.parametrize(
    ("name", "frames", "turns", "written", "skipped"),
    [("bottle_cap.mp4", 175.7, 3.48, 612, 2), ("pillow_6x360.avi", 57.37, 5.98, 344, 0)],
)
def test_real_clips_tell_the_length_of_their_turns(
    shared_data: Path, tmp_path: Path, name: str, frames: float, turns: float, written: int, skipped: int
) -> None:
    plan = ImportPlan(lasers={"laser": "red"}, image_format="jpeg")
    report = import_pictures(shared_data / "video" / name, tmp_path / "rec", plan)
    assert report.turn is not None
    assert report.turn.frames == pytest.approx(frames, abs=0.1)
    assert report.turn.turns == pytest.approx(turns, abs=0.01)
    assert (report.written, len(report.skipped)) == (written, skipped)


def test_a_real_clip_padded_to_250_frames_a_second_is_seen_through(shared_data: Path) -> None:
    survey = Video(shared_data / "video" / "motor.mp4").survey(lambda done, total: None)
    turn = lay_out(survey, ImportPlan(lasers={"laser": "red"}), "motor.mp4").turn
    assert turn is not None
    assert turn.frames * survey.stride == pytest.approx(2200.0, abs=4.0)
    assert turn.frames == pytest.approx(176.0, abs=0.5)
    assert survey.repeated > 7000
