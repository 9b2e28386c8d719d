"""The exposure search, on rendered stripes whose light grows with the exposure."""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from app.devices.camera import Camera
from app.devices.camera_driver import CameraFacts, Control, ControlName, RawFrame
from app.devices.exposure import find_exposure
from app.devices.stripe_look import MOST_CLIPPED, look_at_stripe
from app.errors import DeviceError, DeviceRefused
from app.geometry.arrays import Floats
from app.geometry.transform import RigidTransform
from app.simulation.boards import table_bodies
from app.simulation.objects import make_object
from app.simulation.render import Renderer
from app.simulation.rig import standard_rig
from app.simulation.scene import Body, Scene
from app.vision.stripe import Image, LaserView

_TINT = np.array([0.035, 0.075, 1.0])


class StripeCamera:
    """Sees a rendered ball in the light of a red laser, the longer the exposure the brighter.

    Attributes:
        knob: the control that it has.
        unit: its value at which the light is as the renderer has it.
        bend: exponent of the camera's response; 1 for a straight one.
        is_lit: whether the laser is on.
    """

    def __init__(
        self,
        ambient: Floats,
        light: Floats,
        *,
        knob: ControlName | None = ControlName.EXPOSURE,
        limits: tuple[float, float] = (100.0, 20_000.0),
        unit: float = 4000.0,
        bend: float = 1.0,
    ) -> None:
        self.ambient, self.light, self.unit, self.bend = ambient, light, unit, bend
        self.knob, self.limits = knob, limits
        self.is_lit, self.value = False, 0.3 * limits[1]
        self.is_automatic = True
        self.facts = CameraFacts("stripes", "here", (light.shape[1], light.shape[0]), 100.0, True, False)

    def switch(self, is_on: bool) -> None:
        self.is_lit = is_on

    def connect(self) -> None:
        """Always there."""

    def disconnect(self) -> None:
        """Always there."""

    def grab(self, timeout_s: float) -> RawFrame:
        time.sleep(0.01)
        taken_s, is_lit, value = time.monotonic(), self.is_lit, self.value
        return RawFrame(lambda: self.expose(is_lit, value, round(taken_s * 1e6)), taken_s)

    def controls(self) -> Mapping[ControlName, Control]:
        if self.knob is None:
            return {}
        return {self.knob: Control(self.knob, self.value, *self.limits, self.is_automatic)}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        self.is_automatic = value is None
        if value is not None:
            self.value = float(round(min(max(value, self.limits[0]), self.limits[1])))
        return self.controls()[name]

    def expose(self, is_lit: bool, value: float, seed: int) -> Image:
        scene = self.ambient + (self.light[:, :, None] * _TINT if is_lit else 0.0)
        levels = 255.0 * (np.clip(value / self.unit * scene / 255.0, 0.0, 1.0) ** self.bend)
        noise = np.random.default_rng(seed).standard_normal(levels.shape, np.float32)
        return np.clip(levels + 1.5 * noise, 0.0, 255.0).astype(np.uint8)


@pytest.fixture(scope="module")
def light() -> tuple[Floats, Floats]:
    """What room and laser add to every pixel, grey levels."""
    scanner = standard_rig(320, 240)
    ball = Body(make_object("sphere").mesh, RigidTransform(np.eye(3), np.zeros(3)), True)
    renderer = Renderer(Scene(scanner, (*table_bodies(scanner.table_radius_mm, None), ball)))
    view = renderer.look(0.0)
    return np.asarray(view.ambient, np.float64), np.asarray(renderer.irradiance(view, "left"), np.float64)


LookThrough = Callable[..., tuple[Camera, StripeCamera]]


@pytest.fixture
def look_through(light: tuple[Floats, Floats]) -> Iterator[LookThrough]:
    cameras: list[Camera] = []

    def look_through(brightness: float, *, room: float = 0.3, **options: Any) -> tuple[Camera, StripeCamera]:
        driver = StripeCamera(room * light[0], brightness * light[1], **options)
        camera = Camera(driver)
        cameras.append(camera)
        camera.connect()
        return camera, driver

    yield look_through
    for camera in cameras:
        camera.disconnect()


@pytest.mark.parametrize("brightness", [0.5, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("bend", [1.0, 0.45])
def test_the_longest_exposure_is_found_that_clips_hardly_any_line(
    look_through: LookThrough, brightness: float, bend: float
) -> None:
    camera, driver = look_through(brightness, bend=bend)
    found = find_exposure(camera, driver.switch, colour="red")
    assert found.look.clipped < MOST_CLIPPED
    assert found.advice == ""
    assert found.control.value == found.look.value == driver.value
    assert not driver.is_lit
    assert len(found.tried) <= 6
    longer = driver.value * 1.5
    lit, dark = driver.expose(True, longer, 1), driver.expose(False, longer, 2)
    look = look_at_stripe(LaserView(lit, dark, "red"), "zero-crossing", longer)
    assert look.is_clipped


def test_a_stripe_that_clips_at_the_shortest_exposure_is_told_and_nothing_is_changed(
    look_through: LookThrough,
) -> None:
    camera, driver = look_through(400.0)
    with pytest.raises(
        DeviceError, match=r"% of its lines even at the shortest exposure \(100 us\)"
    ) as caught:
        find_exposure(camera, driver.switch, colour="red")
    assert "grey filter" in caught.value.hint
    assert driver.is_automatic
    assert not driver.is_lit


def test_a_stripe_that_is_weak_at_the_longest_exposure_is_used_with_advice(look_through: LookThrough) -> None:
    camera, driver = look_through(0.12, room=0.02)
    found = find_exposure(camera, driver.switch, colour="red", longest_us=3500.0)
    assert found.advice == "dim"
    assert driver.value == 3500.0
    assert len(found.tried) == 1


def test_without_a_stripe_it_says_so_and_restores_what_was(look_through: LookThrough) -> None:
    camera, driver = look_through(1.0)
    camera.set_control(ControlName.EXPOSURE, 777.0)
    with pytest.raises(DeviceError, match="no stripe is to be seen"):
        find_exposure(camera, lambda is_on: None, colour="red")
    assert (driver.value, driver.is_automatic) == (777.0, False)


def test_a_mirror_in_the_scene_makes_the_stripe_uneven(look_through: LookThrough) -> None:
    camera, driver = look_through(1.0)
    shiny = driver.light.copy()
    shiny[100:130] *= 30.0
    driver.light = shiny
    found = find_exposure(camera, driver.switch, colour="red")
    assert found.advice == "uneven"
    assert found.look.clipped < MOST_CLIPPED


def test_a_camera_without_exposure_gets_its_gain_set(look_through: LookThrough) -> None:
    camera, driver = look_through(1.0, knob=ControlName.GAIN, limits=(0.0, 255.0), unit=60.0)
    found = find_exposure(camera, driver.switch, colour="red")
    assert found.control.name is ControlName.GAIN
    assert found.look.clipped < MOST_CLIPPED
    assert found.look.strength_grey > 60.0


def test_a_camera_without_either_is_refused(look_through: LookThrough) -> None:
    camera, driver = look_through(1.0, knob=None)
    with pytest.raises(DeviceRefused, match="neither exposure nor gain"):
        find_exposure(camera, driver.switch)


def test_no_longer_exposure_than_a_period_is_chosen(look_through: LookThrough) -> None:
    camera, driver = look_through(0.2, room=0.02)
    find_exposure(camera, driver.switch, colour="red")
    assert driver.value == 10_000.0
