"""What every kind of camera must do.

A camera's test module subclasses `CameraContract` and adds a fixture `unplugged`: a driver that is not yet
connected, of a camera that is there.
"""

import contextlib
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from app.devices.camera import Camera
from app.devices.camera_driver import CameraDriver, ControlName, RawFrame, pixels_of
from app.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from app.recording.picture import decode, inspect

_SOON_S = 60.0


class CameraContract:
    """Attributes and methods that a subclass sets.

    Attributes:
        can_vanish: whether `vanish` and `come_back` do something.
        frames: how many pictures a test looks at.
    """

    can_vanish = True
    frames = 5

    def vanish(self) -> None:
        """The camera is unplugged."""
        raise NotImplementedError

    def come_back(self) -> None:
        """It is plugged in again, as it was."""
        raise NotImplementedError

    @pytest.fixture
    def driver(self, unplugged: CameraDriver) -> Iterator[CameraDriver]:
        unplugged.connect()
        yield unplugged
        unplugged.disconnect()

    @pytest.fixture
    def camera(self, unplugged: CameraDriver) -> Iterator[Camera]:
        camera = Camera(unplugged)
        camera.connect()
        yield camera
        camera.disconnect()

    def test_it_says_what_it_is_once_it_is_connected(self, driver: CameraDriver) -> None:
        facts = driver.facts
        assert facts.name
        assert facts.place
        assert min(facts.size) > 0
        assert facts.fps >= 0.0

    def test_every_picture_has_the_size_that_it_says(self, driver: CameraDriver) -> None:
        for _ in range(self.frames):
            data = picture(driver).data
            made = data() if callable(data) else data
            image = pixels_of(made, driver.facts.size)
            assert image.dtype == np.uint8
            assert image.shape[1::-1] == driver.facts.size

    def test_a_camera_that_gives_jpeg_gives_whole_ones(self, driver: CameraDriver) -> None:
        for _ in range(self.frames):
            data = picture(driver).data
            made = data() if callable(data) else data
            if driver.facts.gives_jpeg:
                assert isinstance(made, bytes)
                assert inspect(made).format == "jpeg"
            else:
                assert not isinstance(made, bytes) or inspect(made).format == "png"

    def test_it_tells_times_if_it_says_so_and_they_rise(self, driver: CameraDriver) -> None:
        times_s = []
        for _ in range(self.frames):
            frame = picture(driver)
            if not driver.facts.has_timestamps:
                assert frame.exposed_s is None
                continue
            assert frame.exposed_s is not None
            assert frame.exposed_s <= time.monotonic()
            times_s.append(frame.exposed_s)
        assert times_s == sorted(set(times_s))

    def test_a_control_that_is_set_is_read_back(self, driver: CameraDriver) -> None:
        for name, control in driver.controls().items():
            assert control.name is name
            value = 100.0
            if control.lowest is not None and control.highest is not None:
                assert control.lowest <= control.highest
                value = 0.6 * control.lowest + 0.4 * control.highest
            chosen = driver.set_control(name, value)
            assert chosen.name is name
            assert not chosen.is_automatic
            assert driver.controls()[name] == chosen
            if control.lowest is not None and control.highest is not None and chosen.value is not None:
                assert control.lowest <= chosen.value <= control.highest

    def test_a_control_that_it_lacks_is_refused_in_a_sentence(self, driver: CameraDriver) -> None:
        for name in ControlName:
            if name not in driver.controls():
                with pytest.raises(DeviceRefused, match=name.value.replace("_", " ")):
                    driver.set_control(name, 1.0)

    def test_a_picture_that_is_not_waited_for_comes_later(self, driver: CameraDriver) -> None:
        with contextlib.suppress(DeviceTimeout):
            driver.grab(0.0)
        picture(driver)

    def test_it_can_be_connected_again(self, unplugged: CameraDriver) -> None:
        sizes = set()
        for _ in range(3):
            unplugged.connect()
            sizes.add(unplugged.facts.size)
            picture(unplugged)
            unplugged.disconnect()
        assert len(sizes) == 1

    def test_letting_go_never_fails(self, unplugged: CameraDriver) -> None:
        unplugged.disconnect()
        unplugged.connect()
        unplugged.disconnect()
        unplugged.disconnect()

    def test_a_camera_that_is_let_go_gives_an_error_and_no_picture(self, unplugged: CameraDriver) -> None:
        unplugged.connect()
        unplugged.disconnect()
        with pytest.raises(DeviceError):
            unplugged.grab(0.1)
        with pytest.raises(DeviceError):
            unplugged.set_control(ControlName.EXPOSURE, 100.0)

    def test_a_camera_that_vanishes_is_missed_and_can_be_connected_when_it_is_back(
        self, driver: CameraDriver
    ) -> None:
        if not self.can_vanish:
            pytest.skip("nothing to unplug")
        picture(driver)
        self.vanish()
        with pytest.raises((DeviceLost, DeviceTimeout)):
            drain(driver)
        driver.disconnect()
        with pytest.raises(DeviceError):
            driver.connect()
        self.come_back()
        driver.connect()
        picture(driver)

    def test_a_fresh_frame_was_exposed_after_it_was_asked_for(self, camera: Camera) -> None:
        indices = []
        for _ in range(self.frames):
            asked_s = time.monotonic()
            frame = camera.fresh_frame(timeout_s=_SOON_S)
            assert frame.exposed_s >= asked_s
            indices.append(frame.index)
        assert indices == sorted(set(indices))

    def test_a_frame_can_be_seen_and_stored(self, camera: Camera) -> None:
        frame = camera.fresh_frame(timeout_s=_SOON_S)
        width, height = frame.size
        assert frame.image().shape[:2] == (height, width)
        assert frame.image(grey=True).shape == (height, width)
        assert decode(frame.encoded(), frame.size).shape[:2] == (height, width)

    def test_controls_can_be_set_while_pictures_come(self, camera: Camera) -> None:
        present = camera.controls()
        errors: list[DeviceError] = []

        def turn_knobs() -> None:
            try:
                for name, control in present.items():
                    for share in (0.2, 0.3, 0.4):
                        low, high = control.lowest or 0.0, control.highest or 100.0
                        camera.set_control(name, low + share * (high - low))
            except DeviceError as error:
                errors.append(error)

        thread = threading.Thread(target=turn_knobs)
        thread.start()
        with camera.stream() as stream:
            for _ in stream:
                if not thread.is_alive():
                    break
        thread.join()
        assert not errors


def picture(driver: CameraDriver) -> RawFrame:
    """The next picture, waited for as long as a test may last."""
    deadline_s = time.monotonic() + _SOON_S
    while True:
        try:
            return driver.grab(0.1)
        except DeviceTimeout:
            if time.monotonic() > deadline_s:
                raise


def drain(driver: CameraDriver, timeout_s: float = 1.0, taken: list[RawFrame] | None = None) -> None:
    """Take whatever is under way, until an error ends it."""
    deadline_s = time.monotonic() + _SOON_S
    while time.monotonic() < deadline_s:
        frame = driver.grab(timeout_s)
        if taken is not None:
            taken.append(frame)
