"""Network cameras: streams over HTTP as servers really write them, single pictures, RTSP, kept secrets."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import cv2
import pytest
from camera_contract import CameraContract, drain, picture
from picture_server import PictureServer
from scripted_camera import SIZE, noise_picture

from app.devices.camera import Camera
from app.devices.camera_driver import CAMERAS, CameraDriver, RawFrame
from app.devices.cameras.url import UrlCamera
from app.devices.http_request import shown
from app.errors import (
    DeviceDenied,
    DeviceError,
    DeviceLost,
    DeviceNotFound,
    DeviceTimeout,
    DeviceUnrecognised,
)
from app.recording.picture import encode, inspect


@pytest.fixture
def server() -> Iterator[PictureServer]:
    server = PictureServer()
    yield server
    server.stop()


class TestStream(CameraContract):
    path = "/video"
    tells_length = True

    @pytest.fixture
    def unplugged(self) -> Iterator[CameraDriver]:
        self.server = PictureServer()
        self.server.tells_length = self.tells_length
        yield UrlCamera(self.server.url(self.path), fps=100.0, timeout_s=2.0)
        self.server.stop()

    def vanish(self) -> None:
        self.server.stop()

    def come_back(self) -> None:
        self.server = PictureServer(self.server.port)


class TestStreamThatTellsNoLengths(TestStream):
    tells_length = False


class TestSinglePictures(TestStream):
    path = "/shot.jpg"


class TestRtsp(CameraContract):
    @pytest.fixture
    def unplugged(self) -> CameraDriver:
        self.video = FakeVideo()
        return UrlCamera("rtsp://phone:8554/live", capture_class=self.video.open)

    def vanish(self) -> None:
        self.video.is_gone = True

    def come_back(self) -> None:
        self.video.is_gone = False


@pytest.mark.parametrize("boundary", ["--frame", "frame", "--Ba4oTvQMY8ew04N8dcnM"])
@pytest.mark.parametrize("tells_length", [True, False])
def test_pictures_pass_through_whatever_the_boundary(
    server: PictureServer, boundary: str, tells_length: bool
) -> None:
    server.boundary, server.tells_length = boundary, tells_length
    with opened(UrlCamera(server.url())) as driver:
        assert [picture(driver).data for _ in range(5)] == [
            encode(noise_picture(number), "jpeg") for number in range(1, 6)
        ]
        assert driver.facts.size == SIZE


def test_a_camera_that_has_moved_is_followed(server: PictureServer) -> None:
    with opened(UrlCamera(server.url("/moved"))) as driver:
        assert picture(driver).data
    with pytest.raises(DeviceUnrecognised, match="from place to place"):
        UrlCamera(server.url("/round")).connect()


@pytest.mark.parametrize(
    ("path", "error", "sentence"),
    [
        ("/", DeviceUnrecognised, "is a web page, no camera"),
        ("/sound", DeviceUnrecognised, "sends audio/wav, no JPEG pictures"),
        ("/nothing", DeviceNotFound, r"there is nothing at .*/nothing \(404\)"),
        ("/busy", DeviceDenied, r"is busy \(503\)"),
    ],
)
def test_an_address_that_is_no_camera_is_told_in_a_sentence(
    server: PictureServer, path: str, error: type[DeviceError], sentence: str
) -> None:
    with pytest.raises(error, match=sentence) as caught:
        UrlCamera(server.url(path)).connect()
    assert caught.value.hint


def test_a_closed_port_and_an_unknown_machine_are_not_found(server: PictureServer) -> None:
    server.stop()
    with pytest.raises(DeviceNotFound, match=r"nothing answers at http://127\.0\.0\.1"):
        UrlCamera(server.url()).connect()
    with pytest.raises(DeviceNotFound, match=r"no machine is known as nowhere\.invalid"):
        UrlCamera("http://nowhere.invalid/video").connect()


@pytest.mark.parametrize(
    "url", ["ftp://host/video", "phone", "http:///video", "http://host:port/", "file:///x"]
)
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(DeviceNotFound, match="is no address of a camera"):
        UrlCamera(url).connect()


def test_a_machine_that_takes_the_call_and_says_nothing_is_given_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf, pytest.raises(DeviceTimeout, match="open http"):
        UrlCamera(f"http://127.0.0.1:{deaf.getsockname()[1]}/", timeout_s=0.1).connect()


def test_something_that_speaks_no_http_is_not_recognised() -> None:
    with socket.create_server(("127.0.0.1", 0)) as rude:
        driver = UrlCamera(f"http://127.0.0.1:{rude.getsockname()[1]}/", timeout_s=2.0)

        def answer() -> None:
            link, _ = rude.accept()
            link.recv(1000)
            link.sendall(b"SSH-2.0-OpenSSH_9.6\r\n")
            link.close()

        with in_background(answer), pytest.raises(DeviceUnrecognised, match="does not speak HTTP"):
            driver.connect()


def test_name_and_password_are_sent_and_never_shown(server: PictureServer) -> None:
    server.password = "Basic YWxpY2U6czNjcmV0"
    secret = f"http://alice:s3cret@127.0.0.1:{server.port}/video?pwd=s3cret"
    with opened(UrlCamera(secret)) as driver:
        assert "s3cret" not in driver.facts.place
        server.is_gone = True
        with pytest.raises(DeviceLost) as lost:
            drain(driver)
    server.is_gone, server.password = False, "Basic other"
    with pytest.raises(DeviceDenied, match="another name or password") as denied:
        UrlCamera(secret).connect()
    with pytest.raises(DeviceNotFound) as unknown:
        UrlCamera("gopher://alice:s3cret@phone/").connect()
    for error in (lost.value, denied.value, unknown.value):
        assert "s3cret" not in f"{error!r} {error} {error.hint}"
        assert "alice" not in str(error)


def test_rtsp_keeps_the_secret_too(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DeviceNotFound, match=r"rtsp://127.0.0.1:9/live\?\.\.\. gives no video"):
        UrlCamera("rtsp://alice:s3cret@127.0.0.1:9/live?token=s3cret", timeout_s=1.0).connect()
    assert "s3cret" not in "".join(capfd.readouterr())


def test_an_address_is_shown_without_what_may_be_secret() -> None:
    assert shown("http://a:b@host:80/x?user=a&pwd=b#c") == "http://host:80/x?..."
    assert shown("rtsp://host/live") == "rtsp://host/live"


def test_a_stream_that_stops_is_lost(server: PictureServer) -> None:
    with opened(UrlCamera(server.url(), timeout_s=0.2)) as driver:
        server.is_silent = True
        with pytest.raises(DeviceLost, match="has fallen silent"):
            drain(driver)


def test_a_stream_that_ends_is_lost(server: PictureServer) -> None:
    with opened(UrlCamera(server.url())) as driver:
        server.cuts = True
        taken: list[RawFrame] = []
        with pytest.raises(DeviceLost, match="has closed the connection"):
            drain(driver, taken=taken)
    assert taken
    assert all(isinstance(frame.data, bytes) and inspect(frame.data).size == SIZE for frame in taken)


def test_half_a_picture_at_the_end_is_not_taken_for_one(server: PictureServer) -> None:
    camera = Camera(UrlCamera(server.url()))
    camera.connect()
    try:
        camera.fresh_frame()
        server.cuts = True
        deadline_s = time.monotonic() + 60.0
        while camera.state.reopened == 0 and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert inspect(camera.fresh_frame().encoded()).size == SIZE
        assert camera.state.reopened == 1
        assert "has closed the connection" in camera.state.last_error
    finally:
        camera.disconnect()


def test_a_slow_camera_is_no_frozen_one(server: PictureServer) -> None:
    server.period_s = 1.1
    camera = Camera(UrlCamera(server.url()))
    camera.connect()
    try:
        with camera.stream() as stream:
            next(stream)
            next(stream)
        assert camera.state.reopened == 0
    finally:
        camera.disconnect()


def test_letting_go_of_a_silent_camera_leaves_no_connection(server: PictureServer) -> None:
    driver = UrlCamera(server.url(), timeout_s=60.0)
    driver.connect()
    server.is_silent = True
    driver.disconnect()
    assert not [t for t in threads() if t == "camera-read"]


def test_a_stream_without_a_picture_in_it_is_not_recognised(server: PictureServer) -> None:
    server.picture = lambda: b"not a picture at all"  # type: ignore[method-assign]
    with pytest.raises(DeviceUnrecognised, match="sends a picture that is neither PNG nor JPEG"):
        UrlCamera(server.url()).connect()


def test_pictures_that_are_empty_are_none(server: PictureServer) -> None:
    server.picture = lambda: b""  # type: ignore[method-assign]
    with pytest.raises(DeviceUnrecognised, match="sends no picture"):
        UrlCamera(server.url("/shot.jpg"), fps=1000.0).connect()


def test_ffmpeg_is_asked_for_what_is_new_and_for_its_patience() -> None:
    video = FakeVideo()
    with opened(UrlCamera("rtsp://phone/live", timeout_s=3.0, capture_class=video.open)) as driver:
        assert driver.facts.place == "rtsp://phone/live"
        assert not driver.facts.gives_jpeg
    assert video.opened == [
        ("rtsp://phone/live", cv2.CAP_FFMPEG,
         [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 3000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 3000]),
    ]  # fmt: skip


def test_it_is_known_by_its_name() -> None:
    assert CAMERAS.maker("url") is UrlCamera


class FakeVideo:
    """What OpenCV makes of RTSP."""

    def __init__(self) -> None:
        self.is_gone = False
        self.opened: list[tuple[str, int, list[int]]] = []
        self.number = 0

    def open(self, url: str, api: int, wishes: Sequence[int]) -> "FakeVideo":
        self.opened.append((url, api, list(wishes)))
        return self

    def isOpened(self) -> bool:  # noqa: N802 (OpenCV's name)
        return not self.is_gone

    def read(self) -> tuple[bool, Any]:
        if self.is_gone:
            return False, None
        time.sleep(0.005)
        self.number += 1
        return True, noise_picture(self.number)

    def get(self, prop: int, /) -> float:
        return -1.0

    def set(self, prop: int, value: float, /) -> bool:
        return False

    def release(self) -> None:
        """Nothing is held."""


@contextlib.contextmanager
def opened(driver: UrlCamera) -> Iterator[UrlCamera]:
    driver.connect()
    try:
        yield driver
    finally:
        driver.disconnect()


@contextlib.contextmanager
def in_background(work: Callable[[], None]) -> Iterator[None]:
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        thread.join()


def threads() -> list[str]:
    return [thread.name for thread in threading.enumerate()]
