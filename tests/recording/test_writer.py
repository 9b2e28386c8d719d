"""What is written is read back, whatever happens in between."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from app.errors import OutputError, RecordingError
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.manifest import Header
from app.recording.picture import encode
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.recording.writer import RecordingWriter
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import Image

SIZE = (8, 6)


def header(**more: object) -> Header:
    return Header.of(SIZE, {"left": "red", "right": "green"}, extra=more)


def picture(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 255, (6, 8, 3), dtype=np.uint8)


def scan(number: int) -> Shot:
    return Shot(picture(number), Role.SCAN, ("left",), angle_deg=0.1 * number, time_s=number / 3)


def test_what_is_written_is_read_back_to_the_bit(tmp_path: Path) -> None:
    board = Shot(picture(7), Role.LASER_PLANE, (), pose=3, exposure_us=1000.0)
    with RecordingWriter.create(tmp_path / "rec", header()) as writer:
        for shot in (board, scan(1), scan(2)):
            writer.append(shot)
    shots = list(Recording.open(tmp_path / "rec").shots())
    for shot, back in zip((board, scan(1), scan(2)), shots, strict=True):
        assert_array_equal(shot.image, back.image)
        for fact in ("role", "lasers_on", "angle_deg", "pose", "time_s", "exposure_us"):
            assert getattr(shot, fact) == getattr(back, fact)
    assert not (tmp_path / "rec" / JOURNAL_FILE).exists()


@pytest.mark.parametrize(
    "board",
    [
        BoardSpec("chessboard", 9, 6, 10.0),
        BoardSpec("charuco", 5, 7, 40.0, 20.0, "DICT_6X6_250"),
        BoardSpec("circles", 4, 5, 12.5),
        BoardSpec("asymmetric_circles", 4, 11, 20.1),
    ],
)
def test_boards_and_platters_come_back_as_they_went(tmp_path: Path, board: BoardSpec) -> None:
    platter = PlatterSpec("DICT_4X4_50", 30.0, (5, 18))
    facts = Header.of(SIZE, direction="cw", seconds_per_turn=12.5, board=board, platter=platter)
    there = RecordingWriter.create(tmp_path, facts).close()
    assert (there.board, there.platter, there.direction, there.seconds_per_turn) == (
        board, platter, "cw", 12.5,
    )  # fmt: skip
    assert Recording.open(tmp_path).board == board


def test_unknown_keys_survive_being_added_to(tmp_path: Path) -> None:
    with RecordingWriter.create(tmp_path, header(weather={"rain": [1, None]})) as writer:
        writer.append_encoded(encode(picture(0)), Role.TEXTURE, angle_deg=1.0, extra={"note": "dusty"})
    with RecordingWriter.resume(tmp_path) as writer:
        writer.append(scan(1))
    there = Recording.open(tmp_path)
    assert there.extra == {"weather": {"rain": [1, None]}}
    assert [entry.unknown for entry in there.entries] == [{"note": "dusty"}, {}]


def test_a_crash_loses_nothing_that_was_taken(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    for number in range(3):
        writer.append(scan(number))
    writer.suspend()
    with (tmp_path / JOURNAL_FILE).open("ab") as journal:
        journal.write(b'{"file": "frames/0000')
    there = Recording.open(tmp_path)
    assert there.is_interrupted
    assert [shot.angle_deg for shot in there.shots()] == [0.0, 0.1, 0.2]
    with RecordingWriter.resume(tmp_path) as again:
        again.append(scan(3))
    there = Recording.open(tmp_path)
    assert not there.is_interrupted
    assert len(there.entries) == 4


def test_a_frame_that_never_reached_the_disk_is_left_out_and_named(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    for number in range(2):
        writer.append(scan(number))
    writer.suspend()
    (tmp_path / "frames/000001.png").write_bytes(b"")
    there = Recording.open(tmp_path)
    assert (len(there.entries), there.left_out) == (1, ("frames/000001.png",))


def test_an_interrupted_block_keeps_its_frames(tmp_path: Path) -> None:
    def interrupted_scan() -> None:
        with RecordingWriter.create(tmp_path, header()) as writer:
            writer.append(scan(0))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_scan()
    assert Recording.open(tmp_path).is_interrupted


def test_what_a_killed_program_had_begun_to_write_is_swept_away(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    writer.append(scan(0))
    writer.suspend()
    (tmp_path / "frames/.000001.png.x1y2.part").write_bytes(b"half")
    RecordingWriter.resume(tmp_path).close()
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["000000.png"]


def test_discarding_takes_back_a_new_recording_and_its_folder(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path / "rec", header())
    writer.append(scan(0))
    writer.discard()
    assert list(tmp_path.iterdir()) == []


def test_discarding_an_addition_leaves_what_was_there(tmp_path: Path) -> None:
    with RecordingWriter.create(tmp_path, header()) as writer:
        writer.append(scan(0))
    before = (tmp_path / MANIFEST_FILE).read_bytes()
    writer = RecordingWriter.resume(tmp_path)
    writer.append(scan(1))
    writer.discard()
    assert (tmp_path / MANIFEST_FILE).read_bytes() == before
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["000000.png", "frames", MANIFEST_FILE]


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("irreplaceable")
    with pytest.raises(OutputError, match="is not empty"):
        RecordingWriter.create(tmp_path, header())


def test_a_full_disk_is_one_sentence_and_leaves_whole_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    writer.append(scan(0))

    def full(path: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(OutputError, match=r"000001\.png: no space left on device"):
            writer.append(scan(1))
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["000000.png"]
    writer.append(scan(2))
    assert len(writer.close().entries) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="no file can be kept from growing there")
def test_a_line_of_which_the_disk_takes_a_part_leaves_the_journal_whole(tmp_path: Path) -> None:
    import resource

    writer = RecordingWriter.create(tmp_path, header())
    writer.append(scan(0))
    before, limits = (tmp_path / JOURNAL_FILE).stat().st_size, resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (before + 20, limits[1]))
    try:
        with pytest.raises(OutputError, match="no space left on device"):
            writer.append(scan(1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / JOURNAL_FILE).stat().st_size == before
    writer.append(scan(2))
    writer.suspend()
    assert len(Recording.open(tmp_path).entries) == 2


@pytest.mark.parametrize(
    ("shot", "problem"),
    [
        (Shot(np.zeros((6, 9, 3), np.uint8), Role.SCAN, angle_deg=0.0), "9 x 6 pixels, not 8 x 6"),
        (Shot(picture(0), Role.SCAN, ("middle",), angle_deg=0.0), "no laser called 'middle'"),
        (Shot(picture(0), Role.SCAN, ("left",), angle_deg=float("nan")), "angle_deg"),
    ],
)
def test_a_shot_that_does_not_fit_is_refused_and_the_rest_stands(
    tmp_path: Path, shot: Shot, problem: str
) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    with pytest.raises(RecordingError, match=problem):
        writer.append(shot)
    assert len(writer.close().entries) == 0


def test_a_cameras_own_jpeg_is_kept_byte_for_byte(tmp_path: Path) -> None:
    data = encode(picture(1), "jpeg", 80)
    with RecordingWriter.create(tmp_path, header()) as writer:
        entry = writer.append_encoded(data, Role.SCAN, ("left", "right"), 5.0)
    assert entry.file == "frames/000000.jpg"
    assert Recording.open(tmp_path).read_bytes(entry) == data


NUMBERS = st.none() | st.floats(-1e9, 1e9)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.builds(
            Shot,
            st.integers(0, 1000).map(picture),
            st.sampled_from([role for role in Role if role is not Role.SCAN]),
            st.sampled_from([(), ("left",), ("right", "left")]),
            angle_deg=NUMBERS,
            pose=st.none() | st.integers(-(10**9), 10**9),
            time_s=NUMBERS,
            exposure_us=st.none() | st.floats(1e-3, 1e9),
        ),
        max_size=4,
    )
)
def test_any_shots_come_back_as_they_went(shots: list[Shot]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        with RecordingWriter.create(folder, header()) as writer:
            for shot in shots:
                writer.append(shot)
        for shot, back in zip(shots, Recording.open(folder).shots(), strict=True):
            assert_array_equal(shot.image, back.image)
            for fact in ("role", "lasers_on", "angle_deg", "pose", "time_s", "exposure_us"):
                assert getattr(shot, fact) == getattr(back, fact)


def test_a_journal_cut_anywhere_gives_the_frames_before_the_cut(tmp_path: Path) -> None:
    writer = RecordingWriter.create(tmp_path, header())
    for number in range(3):
        writer.append(scan(number))
    writer.suspend()
    journal = tmp_path / JOURNAL_FILE
    whole = journal.read_bytes()
    for end in range(whole.index(b"\n") + 1, len(whole)):
        journal.write_bytes(whole[:end])
        assert len(Recording.open(tmp_path).entries) == whole[:end].count(b"\n") - 1
    journal.write_bytes(whole[:20])
    with pytest.raises(RecordingError, match="holds no frame yet"):
        Recording.open(tmp_path)
