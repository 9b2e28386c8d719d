"""Recorded pictures as a camera: in order, or in step with the table."""

import shutil
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_contract import CameraContract, drain, picture
from scripted_camera import SIZE, noise_picture

from app.devices.camera import Camera
from app.devices.camera_driver import CAMERAS, CameraDriver, Picture
from app.devices.cameras.folder import FolderCamera
from app.errors import DeviceLost, DeviceNotFound, OptionError
from app.recording.picture import encode
from app.recording.reader import Recording
from app.recording.shot import Role

_FPS = 200.0


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(12):
        (folder / f"shot {number}.jpg").write_bytes(encode(noise_picture(number), "jpeg"))
    return folder


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    for number in range(12):
        writer.write(np.full((SIZE[1], SIZE[0], 3), 20 * number, np.uint8))
    writer.release()
    return path


class TestPictures(CameraContract):
    @pytest.fixture
    def unplugged(self, pictures: Path) -> CameraDriver:
        self.folder = pictures
        return FolderCamera(pictures, fps=_FPS)

    def vanish(self) -> None:
        shutil.move(self.folder, self.folder.with_name("elsewhere"))

    def come_back(self) -> None:
        shutil.move(self.folder.with_name("elsewhere"), self.folder)


class TestRecording(CameraContract):
    can_vanish = False

    @pytest.fixture
    def unplugged(self, small_recording: Path) -> CameraDriver:
        return FolderCamera(small_recording, fps=_FPS)


class TestVideo(CameraContract):
    can_vanish = False

    @pytest.fixture
    def unplugged(self, video: Path) -> CameraDriver:
        return FolderCamera(video, fps=_FPS)


def test_pictures_come_in_the_order_of_their_numbers_and_begin_again(pictures: Path) -> None:
    driver = FolderCamera(pictures, fps=_FPS)
    driver.connect()
    shown = [made(driver) for _ in range(14)]
    assert shown == [encode(noise_picture(number % 12), "jpeg") for number in range(14)]


def test_without_repeating_the_camera_is_lost_after_the_last(pictures: Path) -> None:
    driver = FolderCamera(pictures, fps=_FPS, repeats=False)
    driver.connect()
    with pytest.raises(DeviceLost, match="has no more pictures"):
        drain(driver)


def test_frames_of_a_video_come_in_order_and_begin_again(video: Path) -> None:
    driver = FolderCamera(video, fps=_FPS)
    driver.connect()
    means = [float(np.mean(made(driver))) for _ in range(14)]  # type: ignore[arg-type]
    assert means == pytest.approx([20.0 * (number % 12) for number in range(14)], abs=4.0)


def test_only_frames_of_a_role_are_shown(small_recording: Path) -> None:
    recording = Recording.open(small_recording)
    driver = FolderCamera(small_recording / "recording.json", fps=_FPS, role="axis")
    driver.connect()
    axis = recording.select(Role.AXIS)
    assert [made(driver) for _ in axis] == [recording.read_bytes(entry) for entry in axis]


def test_in_step_with_the_table_the_frame_fits_angle_and_lasers(small_recording: Path) -> None:
    recording = Recording.open(small_recording)
    situation: list[tuple[float, tuple[str, ...]]] = [(0.0, ())]
    driver = FolderCamera(small_recording, fps=_FPS, role="scan", ask=lambda: situation[0])
    driver.connect()
    for entry in recording.select(Role.SCAN):
        angle_deg = recording.angle_deg(entry)
        assert angle_deg is not None
        for off_deg in (-10.0, 0.0, 14.0, 360.0, -360.0):
            situation[0] = (angle_deg + off_deg, entry.lasers_on)
            assert made(driver) == recording.read_bytes(entry)


def test_a_table_that_stands_still_is_no_frozen_camera(small_recording: Path) -> None:
    camera = Camera(FolderCamera(small_recording, fps=_FPS, role="scan", ask=lambda: (30.0, ("left",))))
    camera.connect()
    try:
        first = camera.fresh_frame()
        second = camera.fresh_frame()
        assert second.index > first.index
        assert np.array_equal(first.image(), second.image())
        assert camera.state.repeated == 0
    finally:
        camera.disconnect()


def test_pictures_keep_their_rate(pictures: Path) -> None:
    driver = FolderCamera(pictures, fps=50.0)
    driver.connect()
    times_s = [picture(driver).exposed_s or 0.0 for _ in range(6)]
    assert np.diff(times_s).min() >= 0.02 - 1e-9
    assert times_s[-1] <= time.monotonic()


def test_what_holds_no_picture_is_not_found(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "recording.json").write_text("{")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    sentences = {
        "nowhere": "there is nothing at",
        "empty": "holds no picture",
        "text.mp4": "is not a video",
        "broken": "recording.json",
        "damaged": "is truncated",
    }
    for name, sentence in sentences.items():
        with pytest.raises(DeviceNotFound, match=sentence) as caught:
            FolderCamera(tmp_path / name).connect()
        assert caught.value.hint


def test_an_unknown_role_is_an_option_error() -> None:
    with pytest.raises(OptionError, match="'sky'"):
        FolderCamera("somewhere", role="sky")


def test_it_is_known_by_its_name() -> None:
    assert CAMERAS.maker("folder") is FolderCamera


def made(driver: CameraDriver) -> Picture:
    data = picture(driver).data
    return data() if callable(data) else data
