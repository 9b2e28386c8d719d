"""A recording gives its frames one at a time, and says what is wrong with one."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.errors import FrameError, RecordingError
from app.recording.manifest import Header
from app.recording.picture import encode
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.recording.writer import RecordingWriter

SIZE = (16, 12)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Eight frames: four stops, lit and dark."""
    with RecordingWriter.create(tmp_path / "rec", Header.of(SIZE, {"left": "green"})) as writer:
        for number in range(8):
            lit, role = (("left",), Role.SCAN) if number % 2 else ((), Role.TEXTURE)
            image = np.full((12, 16, 3), number * 20, np.uint8)
            writer.append(Shot(image, role, lit, angle_deg=90.0 * (number // 2)))
    return tmp_path / "rec"


def rewrite(folder: Path, **keys: Any) -> None:
    path = folder / "recording.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | keys))


def test_the_folder_and_its_manifest_both_open_it(folder: Path) -> None:
    for path in (folder, folder / "recording.json", str(folder)):
        assert len(Recording.open(path).entries) == 8


@pytest.mark.parametrize("prefetch", [0, 1, 3, 20])
def test_shots_come_in_order_however_far_ahead_they_are_decoded(folder: Path, prefetch: int) -> None:
    recording = Recording.open(folder)
    levels = [int(shot.image[0, 0]) for shot in recording.shots(Role.SCAN, grey=True, prefetch=prefetch)]
    assert levels == [20, 60, 100, 140]
    assert len(list(recording.shots(prefetch=prefetch))) == 8


def test_one_can_stop_in_the_middle(folder: Path) -> None:
    shots = Recording.open(folder).load_each(Recording.open(folder).entries, prefetch=3)
    assert next(shots).name == "frames/000000.png"
    assert hasattr(shots, "close")
    shots.close()


def test_a_frame_is_not_decoded_before_it_is_asked_for(folder: Path) -> None:
    (folder / "frames/000005.png").write_bytes(b"spoilt")
    shots = Recording.open(folder).shots()
    for _ in range(5):
        next(shots)
    with pytest.raises(FrameError, match=r"000005\.png \(frames\[5\]\): is neither PNG nor JPEG"):
        next(shots)


def test_an_error_ahead_comes_in_its_turn(folder: Path) -> None:
    (folder / "frames/000002.png").write_bytes(b"")
    shots = Recording.open(folder).shots(prefetch=5)
    next(shots)
    next(shots)
    with pytest.raises(FrameError, match="is empty"):
        next(shots)


def test_a_truncated_and_a_larger_frame_are_named(folder: Path) -> None:
    frame = folder / "frames/000003.png"
    recording = Recording.open(folder)
    frame.write_bytes(frame.read_bytes()[:-5])
    with pytest.raises(FrameError, match=r"000003\.png .*: is truncated"):
        recording.load(recording.entries[3])
    frame.write_bytes(encode(np.zeros((12, 17, 3), np.uint8)))
    with pytest.raises(FrameError, match=r"000003\.png .*: is 17 x 12 pixels, not 16 x 12"):
        recording.load(recording.entries[3])


def test_a_missing_frame_is_named_at_once(folder: Path) -> None:
    (folder / "frames/000003.png").unlink()
    with pytest.raises(FrameError, match=r"frames\[3\]\.file: frames/000003\.png is missing"):
        Recording.open(folder)


def test_a_link_out_of_the_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(encode(np.zeros((12, 16, 3), np.uint8)))
    frame = folder / "frames/000003.png"
    frame.unlink()
    frame.symlink_to(tmp_path / "secret.png")
    with pytest.raises(FrameError, match=r"frames\[3\]\.file: .* leaves the folder"):
        Recording.open(folder)
    frame.unlink()
    frame.symlink_to(frame)
    with pytest.raises(FrameError, match=r"frames\[3\]\.file: .* is missing"):
        Recording.open(folder)
    frame.unlink()
    frame.mkdir()
    with pytest.raises(FrameError, match=r"frames\[3\]\.file: .* is not a file"):
        Recording.open(folder)


def test_what_is_no_recording_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="is not a folder"):
        Recording.open(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match=r"has no recording\.json"):
        Recording.open(tmp_path)
    (tmp_path / "recording.json").mkdir()
    with pytest.raises(RecordingError, match=r"has no recording\.json"):
        Recording.open(tmp_path)


def test_a_clockwise_table_turns_the_other_way(folder: Path) -> None:
    assert Recording.open(folder).turn_rad(90.0) == pytest.approx(math.pi / 2.0)
    rewrite(folder, turntable={"direction": "cw"})
    assert Recording.open(folder).turn_rad(90.0) == pytest.approx(-math.pi / 2.0)


def test_a_steady_table_tells_the_angle_by_the_time(tmp_path: Path) -> None:
    with RecordingWriter.create(tmp_path / "rec", Header.of(SIZE, seconds_per_turn=20.0)) as writer:
        for time_s in (0.0, 5.0, 30.0):
            writer.append(Shot(np.zeros((12, 16), np.uint8), Role.SCAN, time_s=time_s))
    shots = list(Recording.open(tmp_path / "rec").shots(grey=True))
    assert [shot.angle_deg for shot in shots] == [0.0, 90.0, 540.0]


def test_the_recording_of_real_pictures_opens_and_decodes(shared_data: Path) -> None:
    recording = Recording.open(shared_data / "turntable-green")
    assert [len(recording.select(role)) for role in (Role.INTRINSICS, Role.LASER_PLANE, Role.SCAN)] == [
        27, 41, 160,
    ]  # fmt: skip
    assert sum(shot.image.shape == (480, 640) for shot in recording.shots(grey=True, prefetch=2)) == 228
