"""The Pi's camera, on a stand-in for picamera2."""

import contextlib
import time
from collections.abc import Iterator
from types import ModuleType

import pytest
from camera_contract import CameraContract, drain, picture
from fake_picamera import FakeSensor

from app.devices.camera_driver import CAMERAS, CameraDriver, ControlName
from app.devices.cameras.picamera import PiCamera
from app.errors import DeviceDenied, DeviceLost, DeviceNotFound, DeviceRefused

_EXPOSURE, _GAIN = ControlName.EXPOSURE, ControlName.GAIN


class TestPiCamera(CameraContract):
    @pytest.fixture
    def unplugged(self) -> CameraDriver:
        self.sensor = FakeSensor()
        return pi_camera(self.sensor)

    def vanish(self) -> None:
        self.sensor.is_gone = True

    def come_back(self) -> None:
        self.sensor.is_gone = False


def test_without_the_library_it_says_how_to_get_it() -> None:
    def missing(name: str) -> ModuleType:
        raise ModuleNotFoundError(f"No module named {name!r}")

    with pytest.raises(DeviceNotFound, match="picamera2 is not there") as caught:
        PiCamera(load=missing).connect()
    assert "apt install python3-picamera2" in caught.value.hint


def test_without_a_camera_it_names_the_cable() -> None:
    sensor = FakeSensor()
    with pytest.raises(DeviceNotFound, match=r"no Pi camera 1 \(1 there\)"):
        pi_camera(sensor, number=1).connect()
    sensor.listed = []
    with pytest.raises(DeviceNotFound, match="none there") as caught:
        pi_camera(sensor).connect()
    assert "ribbon cable" in caught.value.hint


def test_a_camera_that_another_program_has_is_denied() -> None:
    sensor = FakeSensor()
    with opened(pi_camera(sensor)), pytest.raises(DeviceDenied, match="another program uses Pi camera 0"):
        pi_camera(sensor).connect()
    with opened(pi_camera(sensor)) as driver:
        assert driver.facts.name == "imx219"
        assert driver.facts.has_timestamps


def test_the_size_is_the_one_that_the_camera_made_of_the_wish() -> None:
    with opened(pi_camera(FakeSensor(), width=65, height=49)) as driver:
        assert driver.facts.size == (64, 48)


def test_an_exposure_is_read_back_from_a_picture_that_was_taken_with_it() -> None:
    sensor = FakeSensor()
    with opened(pi_camera(sensor)) as driver:
        assert driver.controls()[_EXPOSURE].is_automatic
        chosen = driver.set_control(_EXPOSURE, 5000.0)
        assert (chosen.value, chosen.is_automatic) == (4997.0, False)
        assert sensor.written == [{"AeEnable": False, "ExposureTime": 5000}]
        drained = [picture(driver).exposure_us for _ in range(8)]
        assert drained[-1] == 4997.0
        assert driver.set_control(_EXPOSURE, None).is_automatic
        assert sensor.written[-1] == {"AeEnable": True}


def test_a_value_beyond_the_range_becomes_the_end_of_it() -> None:
    with opened(pi_camera(FakeSensor())) as driver:
        assert driver.set_control(_GAIN, 99.0).value == 10.67


def test_a_control_without_an_automatic_says_so() -> None:
    with opened(pi_camera(FakeSensor())) as driver:
        with pytest.raises(DeviceRefused, match="does not choose its brightness by itself"):
            driver.set_control(ControlName.BRIGHTNESS, None)
        assert ControlName.FOCUS not in driver.controls()


def test_a_time_stamp_is_that_of_the_beginning_on_our_clock() -> None:
    with opened(pi_camera(FakeSensor())) as driver:
        asked_s = time.monotonic()
        frame = picture(driver)
        while frame.exposed_s is None or frame.exposed_s < asked_s:
            frame = picture(driver)
        assert frame.exposed_s <= time.monotonic() - 0.0199


def test_a_camera_whose_cable_comes_loose_is_lost() -> None:
    sensor = FakeSensor()
    with opened(pi_camera(sensor)) as driver:
        sensor.is_gone = True
        with pytest.raises(DeviceLost, match="sends no more pictures"):
            drain(driver)


def test_it_is_known_by_its_name() -> None:
    assert CAMERAS.maker("picamera") is PiCamera


def pi_camera(sensor: FakeSensor, number: int = 0, width: int = 64, height: int = 48) -> PiCamera:
    return PiCamera(number, width=width, height=height, fps=200.0, load=sensor.module)


@contextlib.contextmanager
def opened(driver: PiCamera) -> Iterator[PiCamera]:
    driver.connect()
    try:
        yield driver
    finally:
        driver.disconnect()
