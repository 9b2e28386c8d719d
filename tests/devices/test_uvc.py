"""Webcams: what OpenCV's silent failures become, on a fake capture that behaves as OpenCV does."""

import contextlib
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_contract import CameraContract, drain, picture
from fake_capture import MJPG, YUYV, FakeWebcam

from app.devices.camera import Camera
from app.devices.camera_driver import CAMERAS, CameraDriver, ControlName
from app.devices.cameras.uvc import UvcCamera
from app.devices.video_nodes import VideoNodes, control_range
from app.errors import (
    DeviceDenied,
    DeviceError,
    DeviceLost,
    DeviceNotFound,
    DeviceRefused,
    DeviceTimeout,
    DeviceUnrecognised,
    OptionError,
)
from app.recording.picture import encode
from app.vision.stripe import Image

_EXPOSURE, _GAIN, _FOCUS = ControlName.EXPOSURE, ControlName.GAIN, ControlName.FOCUS
_WHITE = ControlName.WHITE_BALANCE


@pytest.fixture
def nodes(tmp_path: Path) -> VideoNodes:
    nodes = VideoNodes(tmp_path / "dev", tmp_path / "sys")
    plug_in(nodes, 0, "Integrated Camera: Integrated C")
    plug_in(nodes, 2, "HD Pro Webcam C920", "usb-046d_HD_Pro_Webcam_C920_3C2A-video-index0")
    plug_in(nodes, 3, "HD Pro Webcam C920", index=1)
    return nodes


@pytest.fixture
def webcam() -> FakeWebcam:
    return FakeWebcam()


class TestUvc(CameraContract):
    formats: tuple[int, ...] = (YUYV, MJPG)

    @pytest.fixture
    def unplugged(self, nodes: VideoNodes) -> CameraDriver:
        self.nodes, self.webcam = nodes, FakeWebcam(formats=self.formats)
        return uvc(self.webcam, nodes)

    def vanish(self) -> None:
        self.webcam.is_gone = True
        unplug(self.nodes, 2)

    def come_back(self) -> None:
        self.webcam.is_gone = False
        plug_in(self.nodes, 4, "HD Pro Webcam C920", "usb-046d_HD_Pro_Webcam_C920_3C2A-video-index0")


class TestUvcWithoutJpeg(TestUvc):
    formats = (YUYV,)


def test_jpeg_passes_through_as_the_camera_made_it(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    made = []

    def make(image: Image) -> bytes:
        made.append(encode(image, "jpeg"))
        return made[-1]

    webcam.makes_jpeg = make
    with opened(uvc(webcam, nodes)) as driver:
        assert driver.facts.gives_jpeg
        assert picture(driver).data in made


def test_what_is_left_in_the_buffer_behind_a_picture_is_cut_off(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    webcam.makes_jpeg = lambda image: encode(image, "jpeg") + b"\0\0\xff\xd8 an older one \xff\xd9\0"
    with opened(uvc(webcam, nodes)) as driver:
        data = picture(driver).data
        assert isinstance(data, bytes)
        assert data.endswith(b"\xff\xd9")
        assert b"an older one" not in data


def test_motion_jpeg_gets_the_tables_that_it_leaves_out(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    whole = []

    def make(image: Image) -> bytes:
        whole.append(encode(image, "jpeg"))
        return without_tables(whole[-1])

    webcam.makes_jpeg = make
    with opened(uvc(webcam, nodes)) as driver:
        assert picture(driver).data in whole


def test_a_damaged_picture_is_left_to_be_counted(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    camera = Camera(uvc(webcam, nodes))
    camera.connect()
    try:
        camera.fresh_frame()
        webcam.makes_jpeg = lambda image: encode(image, "jpeg")[:2000]
        wait_s = time.monotonic() + 60.0
        while camera.state.lost < 3 and time.monotonic() < wait_s:
            time.sleep(0.01)
        assert camera.state.lost >= 3
    finally:
        camera.disconnect()


def test_a_camera_that_begins_with_damaged_pictures_still_gives_jpeg(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    sent = []

    def make(image: Image) -> bytes:
        sent.append(encode(image, "jpeg"))
        return sent[-1][: 500 if len(sent) < 4 else None]

    webcam.makes_jpeg = make
    with opened(uvc(webcam, nodes)) as driver:
        assert driver.facts.gives_jpeg
        assert picture(driver).data in sent[3:]


def test_a_driver_that_decodes_in_spite_of_our_wish_gives_pixels(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    webcam.keeps_converting = True
    with opened(uvc(webcam, nodes)) as driver:
        assert not driver.facts.gives_jpeg
        assert getattr(picture(driver).data, "shape", None) == (480, 640, 3)


def test_a_size_that_the_camera_lacks_becomes_the_one_it_chose(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    with opened(uvc(webcam, nodes, width=300, height=200)) as driver:
        assert driver.facts.size == (320, 240)


def test_exposure_is_in_microseconds_and_a_value_takes_it_from_the_camera(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    with opened(uvc(webcam, nodes)) as driver:
        before = driver.controls()[_EXPOSURE]
        assert (before.value, before.is_automatic) == (15600.0, True)
        chosen = driver.set_control(_EXPOSURE, 2040.0)
        assert (chosen.value, chosen.is_automatic) == (2000.0, False)
        assert webcam.writes[-2:] == [(cv2.CAP_PROP_AUTO_EXPOSURE, 1.0), (cv2.CAP_PROP_EXPOSURE, 20.0)]
        assert driver.set_control(_EXPOSURE, 1e9).value == 204700.0
        assert driver.set_control(_EXPOSURE, None).is_automatic
        assert webcam.writes[-1] == (cv2.CAP_PROP_AUTO_EXPOSURE, 3.0)


def test_frames_know_an_exposure_that_was_set_and_none_that_the_camera_chooses(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    camera = Camera(uvc(webcam, nodes))
    camera.connect()
    try:
        assert camera.fresh_frame().exposure_us is None
        camera.set_control(_EXPOSURE, 300.0)
        frame = camera.fresh_frame()
        assert frame.exposure_us == 300.0
        assert frame.is_timed
    finally:
        camera.disconnect()


def test_controls_that_a_camera_lacks_are_absent_and_those_at_zero_are_not(
    webcam: FakeWebcam, nodes: VideoNodes
) -> None:
    with opened(uvc(webcam, nodes)) as driver:
        assert set(driver.controls()) == set(ControlName) - {_FOCUS}
        assert driver.controls()[_GAIN].value == 0.0
        assert driver.controls()[ControlName.BRIGHTNESS].value == -1.0


def test_a_control_without_an_automatic_says_so(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    with (
        opened(uvc(webcam, nodes)) as driver,
        pytest.raises(DeviceRefused, match="does not choose its gain by itself"),
    ):
        driver.set_control(_GAIN, None)


def test_windows_counts_exposure_in_powers_of_two(webcam: FakeWebcam) -> None:
    webcam.properties = {cv2.CAP_PROP_EXPOSURE: -6.0, cv2.CAP_PROP_AUTO_EXPOSURE: 0.0}
    webcam.limits = {}
    driver = UvcCamera(1, capture_class=webcam.capture, platform="win32", fps=200.0)
    with opened(driver):
        assert webcam.opened == [(1, cv2.CAP_MSMF)]
        assert set(driver.controls()) == {_EXPOSURE}
        assert driver.set_control(_EXPOSURE, 1000.0).value == pytest.approx(976.5625)
        assert webcam.writes == [(cv2.CAP_PROP_EXPOSURE, -10.0)]
        assert driver.set_control(_EXPOSURE, None).is_automatic


def test_a_mac_has_pictures_and_no_controls(webcam: FakeWebcam) -> None:
    with opened(UvcCamera("0", capture_class=webcam.capture, platform="darwin")) as driver:
        assert webcam.opened == [(0, cv2.CAP_AVFOUNDATION)]
        assert not driver.controls()


def test_the_kernel_s_stamp_is_the_end_of_an_exposure(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    stamps_s: list[float] = []

    def stamp() -> float:
        stamps_s.append(time.monotonic())
        return stamps_s[-1]

    webcam.stamp = stamp
    with opened(uvc(webcam, nodes)) as driver:
        unknown = picture(driver).exposed_s
        assert unknown is not None
        assert min(abs(stamp_s - 1.0 / webcam.fps - unknown) for stamp_s in stamps_s) < 1e-5
        driver.set_control(_EXPOSURE, 2000.0)
        frame = picture(driver)
        while frame.exposure_us is None:
            frame = picture(driver)
        assert frame.exposed_s is not None
        assert min(abs(stamp_s - 0.002 - frame.exposed_s) for stamp_s in stamps_s) < 1e-5


def test_times_of_another_clock_are_not_believed(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    webcam.stamp = lambda: time.time() + 1e6
    with opened(uvc(webcam, nodes)) as driver:
        assert not driver.facts.has_timestamps
        assert picture(driver).exposed_s is None


@pytest.mark.parametrize("device", [2, "2", "dev/video2", "c920", "by-id"])
def test_a_camera_has_many_names(
    webcam: FakeWebcam, nodes: VideoNodes, device: int | str, tmp_path: Path
) -> None:
    if device == "dev/video2":
        device = str(tmp_path / "dev" / "video2")
    if device == "by-id":
        device = str(next((tmp_path / "dev" / "v4l" / "by-id").iterdir()))
    with opened(uvc(webcam, nodes, device=device)) as driver:
        assert webcam.opened == [(str(tmp_path / "dev" / "video2"), cv2.CAP_V4L2)]
        assert driver.facts.name == "HD Pro Webcam C920"
        assert driver.facts.place.endswith("usb-046d_HD_Pro_Webcam_C920_3C2A-video-index0")


def test_the_camera_of_the_laptop_itself_is_called_so(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    with opened(uvc(webcam, nodes, device=0)) as driver:
        assert driver.facts.name == "Integrated Camera: Integrated C (built into this computer)"


def test_a_socket_in_the_case_gives_the_laptop_s_camera_away(nodes: VideoNodes, tmp_path: Path) -> None:
    usb_device = tmp_path / "sys" / "devices" / "usb1" / "1-4"
    (usb_device / "1-4:1.0").mkdir(parents=True)
    (usb_device / "removable").write_text("fixed\n")
    (tmp_path / "sys" / "class" / "video4linux" / "video2" / "device").symlink_to(usb_device / "1-4:1.0")
    assert [node.is_built_in for node in nodes.listed()] == [True, True]


def test_a_name_that_fits_two_cameras_must_be_more_exact(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    plug_in(nodes, 5, "HD Pro Webcam C920", "usb-046d_HD_Pro_Webcam_C920_77-video-index0")
    with pytest.raises(DeviceError, match="fits 2 cameras") as caught:
        uvc(webcam, nodes, device="C920").connect()
    assert "3C2A" in caught.value.hint


@pytest.mark.parametrize("device", [7, "logitech", "/nowhere/video0"])
def test_a_camera_that_is_not_there_is_missed_and_the_others_are_named(
    webcam: FakeWebcam, nodes: VideoNodes, device: int | str
) -> None:
    with pytest.raises(DeviceNotFound, match="there is no camera") as caught:
        uvc(webcam, nodes, device=device).connect()
    assert "(HD Pro Webcam C920)" in caught.value.hint


def test_without_any_camera_the_hint_says_so(webcam: FakeWebcam, tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound) as caught:
        uvc(webcam, VideoNodes(tmp_path, tmp_path)).connect()
    assert "no camera at all" in caught.value.hint


def test_a_camera_that_this_user_may_not_open_names_the_group(
    webcam: FakeWebcam, nodes: VideoNodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Root, who runs tests in containers, may open everything.
    monkeypatch.setattr("os.access", lambda path, mode: not str(path).endswith("video2"))
    with pytest.raises(DeviceDenied) as caught:
        uvc(webcam, nodes).connect()
    assert "usermod -a -G video" in caught.value.hint


def test_a_camera_that_another_program_has_is_busy(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    webcam.is_busy = True
    with pytest.raises(DeviceDenied, match="another program uses it"):
        uvc(webcam, nodes).connect()


def test_a_camera_that_is_let_go_is_free_for_others(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    with opened(uvc(webcam, nodes)):
        assert webcam.is_busy
    assert not webcam.is_busy


def test_a_camera_that_opens_and_sends_nothing_is_told_so(
    webcam: FakeWebcam, nodes: VideoNodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.devices.webcam._FIRST_PICTURE_S", 0.05)
    webcam.is_mute = True
    with pytest.raises(DeviceUnrecognised, match="sends no picture"):
        uvc(webcam, nodes).connect()
    assert not webcam.is_busy


def test_a_read_that_hangs_holds_nobody_up(webcam: FakeWebcam, nodes: VideoNodes) -> None:
    driver = uvc(webcam, nodes)
    driver.connect()
    picture(driver)
    webcam.hang.clear()
    with pytest.raises(DeviceTimeout):
        drain(driver, 0.05)
    driver.disconnect()
    with pytest.raises(DeviceLost):
        driver.grab(0.05)
    webcam.hang.set()
    deadline_s = time.monotonic() + 60.0
    while webcam.is_busy and time.monotonic() < deadline_s:
        time.sleep(0.005)
    assert not webcam.is_busy


def test_an_unknown_backend_is_an_option_error() -> None:
    with pytest.raises(OptionError, match="'directx'"):
        UvcCamera(backend="directx")


def test_a_capture_of_opencv_itself_fits(nodes: VideoNodes, tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (64, 48))
    for number in range(12):
        writer.write(np.full((48, 64, 3), 20 * number, np.uint8))
    writer.release()
    driver = UvcCamera(
        2, nodes=nodes, platform="linux", capture_class=lambda *_: cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    )
    with opened(driver):
        assert driver.facts.size == (64, 48)
        assert not driver.controls()
        assert getattr(picture(driver).data, "shape", None) == (48, 64, 3)
        with pytest.raises(DeviceLost, match="sends no more pictures"):
            drain(driver)


def test_it_is_known_by_its_name() -> None:
    assert CAMERAS.maker("uvc") is UvcCamera


def test_opencv_is_silent_about_a_camera_that_is_not_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    nodes = VideoNodes(tmp_path / "dev", tmp_path / "sys")
    plug_in(nodes, 1, "a file, no camera")
    with pytest.raises(DeviceDenied):
        UvcCamera(1, nodes=nodes).connect()
    assert capfd.readouterr().err == ""


def test_the_kernel_is_asked_for_ranges_in_its_own_words() -> None:
    asked = []

    def kernel(handle: int, request: int, question: bytes) -> bytes:
        asked.append((handle, request, struct.unpack_from("=I", question)[0]))
        return struct.pack("=II32siiiiI2I", 0x009A0902, 1, b"exposure", 3, 2047, 1, 250, 0, 0, 0)

    assert control_range(5, _EXPOSURE, kernel) == (3, 2047)
    assert asked == [(5, 0xC0445624, 0x009A0902)]


def uvc(
    webcam: FakeWebcam, nodes: VideoNodes, device: int | str = 2, *, width: int = 640, height: int = 480
) -> UvcCamera:
    return UvcCamera(
        device, width=width, height=height, fps=200.0, capture_class=webcam.capture, nodes=nodes,
        platform="linux",
    )  # fmt: skip


@contextlib.contextmanager
def opened(driver: UvcCamera) -> Iterator[UvcCamera]:
    driver.connect()
    try:
        yield driver
    finally:
        driver.disconnect()


def plug_in(nodes: VideoNodes, number: int, name: str, link: str = "", index: int = 0) -> None:
    entry = nodes.system / "class" / "video4linux" / f"video{number}"
    entry.mkdir(parents=True)
    (entry / "name").write_text(name + "\n")
    (entry / "index").write_text(f"{index}\n")
    nodes.devices.mkdir(exist_ok=True)
    (nodes.devices / f"video{number}").touch()
    if link:
        links = nodes.devices / "v4l" / "by-id"
        links.mkdir(parents=True, exist_ok=True)
        (links / link).symlink_to(f"../../video{number}")


def unplug(nodes: VideoNodes, number: int) -> None:
    node = nodes.devices / f"video{number}"
    for link in (nodes.devices / "v4l" / "by-id").iterdir():
        if link.resolve() == node:
            link.unlink()
    node.unlink()
    entry = nodes.system / "class" / "video4linux" / f"video{number}"
    for file in entry.iterdir():
        file.unlink()
    entry.rmdir()


def without_tables(data: bytes) -> bytes:
    kept, at = data[:2], 2
    while data[at + 1] != 0xDA:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        kept += b"" if data[at + 1] == 0xC4 else data[at:end]
        at = end
    return kept + data[at:]
