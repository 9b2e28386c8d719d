"""What is seen in the pictures of a recording, one situation at a time."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from app.calibration.views import gather
from app.errors import CalibrationError, FrameError
from app.recording.reader import Recording
from app.recording.shot import Role
from app.vision.stripe import STRIPE_DETECTORS, Image

DETECTOR = STRIPE_DETECTORS.make("zero-crossing")


@pytest.fixture
def pose(small_recording: Path, tmp_path: Path) -> Path:
    """A recording of one pose: the board, and each of two lasers on it."""
    folder = tmp_path / "pose"
    shutil.copytree(small_recording, folder, copy_function=os.link)
    document = json.loads((folder / "recording.json").read_text())
    keep(folder, [f for f in document["frames"] if f["role"] == "laser_plane" and f["pose"] == 0])
    return folder


def keep(folder: Path, frames: list[dict[str, Any]]) -> None:
    document = json.loads((folder / "recording.json").read_text())
    (folder / "recording.json").unlink()
    (folder / "recording.json").write_text(json.dumps(document | {"frames": frames}))


def entries(folder: Path) -> list[dict[str, Any]]:
    frames: list[dict[str, Any]] = json.loads((folder / "recording.json").read_text())["frames"]
    return frames


def picture(folder: Path, laser: str = "") -> tuple[Path, Image]:
    """The file that shows a laser, or none."""
    lit = [laser] if laser else []
    path = folder / next(f["file"] for f in entries(folder) if f.get("lasers_on", []) == lit)
    return path, np.asarray(cv2.imread(str(path)), np.uint8)


def put(path: Path, image: Image) -> None:
    path.unlink()
    cv2.imwrite(str(path), image)


def test_frames_of_one_pose_are_one_view(pose: Path) -> None:
    (view,) = gather([Recording.open(pose)], DETECTOR).views
    assert view.role is Role.LASER_PLANE
    assert view.board.is_found
    assert set(view.stripes) == {"left", "right"}
    assert view.across == {"left": 0, "right": 0}
    assert np.isnan(view.angle_rad)
    assert not view.is_on_table


def test_a_lit_frame_shows_the_board_where_there_is_no_dark_one(pose: Path) -> None:
    keep(pose, [frame for frame in entries(pose) if frame.get("lasers_on")])
    (view,) = gather([Recording.open(pose)], DETECTOR).views
    assert view.board.is_found
    assert set(view.stripes) == {"left", "right"}


def test_each_laser_may_run_its_own_way(pose: Path) -> None:
    path, _ = picture(pose, "right")
    _, dark = picture(pose)
    lying = dark.copy()
    profile = 200.0 * np.exp(-0.5 * ((np.arange(480) - 240.0) / 2.0) ** 2)
    lying[:, :, 2] = np.clip(lying[:, :, 2] + profile[:, None], 0, 255).astype(np.uint8)
    put(path, lying)
    (view,) = gather([Recording.open(pose)], DETECTOR).views
    assert view.across == {"left": 0, "right": 1}
    assert np.median(view.stripes["right"].pixels[:, 1]) == pytest.approx(240.0, abs=0.5)


def test_two_lasers_in_one_picture_are_told_apart(pose: Path) -> None:
    (apart,) = gather([Recording.open(pose)], DETECTOR).views
    (left_path, left), (_, right), (_, dark) = (picture(pose, name) for name in ("left", "right", ""))
    both = np.clip(left.astype(int) + right - dark, 0, 255).astype(np.uint8)
    middle = {name: float(np.median(apart.stripes[name].pixels[:, 0])) for name in ("left", "right")}
    order = sorted(middle, key=lambda name: middle[name])
    put(left_path, both)
    file = str(left_path.relative_to(pose))
    keep(
        pose,
        [
            {**frame, "lasers_on": order} if frame["file"] == file else frame
            for frame in entries(pose)
            if frame.get("lasers_on") != ["right"]
        ],
    )
    (together,) = gather([Recording.open(pose)], DETECTOR).views
    for name in order:
        assert np.median(together.stripes[name].pixels[:, 0]) == pytest.approx(middle[name], abs=5.0)


def test_a_picture_without_a_stripe_is_listed(pose: Path) -> None:
    path, _ = picture(pose, "right")
    _, dark = picture(pose)
    put(path, dark)
    seen = gather([Recording.open(pose)], DETECTOR)
    assert set(seen.views[0].stripes) == {"left"}
    assert seen.skipped == ((str(path.relative_to(pose)), "laser right was not seen"),)


def test_a_picture_without_the_board_is_listed(pose: Path) -> None:
    path, dark = picture(pose)
    put(path, np.full_like(dark, 90))
    seen = gather([Recording.open(pose)], DETECTOR)
    assert seen.views == ()
    assert seen.skipped == ((str(path.relative_to(pose)), "the board was not found"),)


def test_a_picture_that_cannot_be_read_ends_it_unless_told_to_go_on(pose: Path) -> None:
    path, _ = picture(pose, "right")
    path.unlink()
    path.write_bytes(b"no picture")
    with pytest.raises(FrameError, match=path.name):
        gather([Recording.open(pose)], DETECTOR)
    seen = gather([Recording.open(pose)], DETECTOR, skips_bad_frames=True)
    assert set(seen.views[0].stripes) == {"left"}
    assert seen.skipped[0][0].endswith(path.name)


def test_several_recordings_of_one_rig_are_joined(pose: Path, tmp_path: Path) -> None:
    shutil.copytree(pose, tmp_path / "second", copy_function=os.link)
    told: list[tuple[int, int]] = []
    recordings = [Recording.open(pose), Recording.open(tmp_path / "second")]
    seen = gather(recordings, DETECTOR, lambda done, total: told.append((done, total)))
    assert len(seen.views) == 2
    assert told == [(1, 2), (2, 2)]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"camera": {"width": 320, "height": 240}}, "picture size"),
        ({"board": {"kind": "chessboard", "columns": 7, "rows": 5, "square_mm": 7.5}}, "board"),
    ],
)
def test_recordings_of_two_rigs_are_refused(
    change: dict[str, Any], what: str, pose: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other"
    shutil.copytree(pose, other)
    document = json.loads((other / "recording.json").read_text())
    (other / "recording.json").write_text(json.dumps(document | change))
    with pytest.raises(CalibrationError, match=f"not of one rig: {what}"):
        gather([Recording.open(pose), Recording.open(other)], DETECTOR)
