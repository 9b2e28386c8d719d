"""The simulated camera keeps its beat, has the faults that are planted, and costs nothing unseen."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_contract import CameraContract

from app.devices.camera_driver import CAMERAS, ControlName, RawFrame, pixels_of
from app.devices.cameras.simulated import SimulatedCamera
from app.errors import DeviceError, DeviceLost, DeviceNotFound, DeviceRefused, DeviceTimeout
from app.simulation.stage import Stage
from app.simulation.world import SimulatedWorld, WorldPlan

SIZE = (160, 96)

MakeCamera = Callable[..., SimulatedCamera]


@pytest.fixture
def make_camera(tmp_path: Path) -> Iterator[MakeCamera]:
    with ExitStack() as worlds:

        def make(**options: Any) -> SimulatedCamera:
            plan = WorldPlan(**{"dialect": "sardauscan", "width": SIZE[0], "height": SIZE[1], **options})
            world = worlds.enter_context(SimulatedWorld(plan, tmp_path))
            camera = CAMERAS.make("simulated", world=world)
            assert isinstance(camera, SimulatedCamera)
            camera.connect()
            worlds.callback(camera.disconnect)
            return camera

        yield make


def begun_s(camera: SimulatedCamera, frame: RawFrame) -> float:
    """World time at which a frame's exposure began."""
    assert frame.exposed_s is not None
    return camera.world.clock.world_s(frame.exposed_s)


def mean_of(frame: RawFrame) -> float:
    assert callable(frame.data)
    return float(pixels_of(frame.data(), SIZE).mean())


class TestSimulatedCamera(CameraContract):
    @pytest.fixture
    def unplugged(self, make_camera: MakeCamera) -> SimulatedCamera:
        self.simulated = make_camera()
        self.simulated.disconnect()
        return self.simulated

    def vanish(self) -> None:
        self.simulated.unplug()

    def come_back(self) -> None:
        self.simulated.plug_in()


def test_pictures_come_on_the_beat_without_a_gap(make_camera: MakeCamera) -> None:
    camera = make_camera(fps=30.0, rate=4.0)
    began = [begun_s(camera, camera.grab(5.0)) for _ in range(20)]

    assert np.allclose(np.diff(began), 1.0 / 30.0, atol=1e-6)
    assert camera.facts.fps == pytest.approx(120.0)


def test_a_picture_arrives_after_exposure_and_latency(make_camera: MakeCamera) -> None:
    camera = make_camera(camera_latency_s=0.12)
    for _ in range(3):
        frame = camera.grab(5.0)
        now_s = camera.world.clock.now_s()
        assert frame.exposure_us is not None
        assert now_s >= begun_s(camera, frame) + 1e-6 * frame.exposure_us + 0.12


def test_the_first_picture_was_exposed_after_connecting(make_camera: MakeCamera) -> None:
    camera = make_camera(camera_latency_s=0.1)
    camera.disconnect()
    time.sleep(0.05)
    now_s = time.monotonic()
    camera.connect()
    frame = camera.grab(5.0)

    assert frame.exposed_s is not None
    assert frame.exposed_s >= now_s


def test_a_reader_that_was_a_little_late_loses_nothing(make_camera: MakeCamera) -> None:
    camera = make_camera(fps=100.0)
    first = begun_s(camera, camera.grab(5.0))
    time.sleep(0.1)
    second = begun_s(camera, camera.grab(5.0))

    assert second == pytest.approx(first + 0.01, abs=1e-6)


@pytest.mark.parametrize("stale", [0, 2])
def test_a_reader_that_was_away_gets_the_stale_pictures_first(make_camera: MakeCamera, stale: int) -> None:
    camera = make_camera(stale_frames=stale)
    first = begun_s(camera, camera.grab(5.0))
    time.sleep(0.4)
    back_s = camera.world.clock.now_s()
    began = [begun_s(camera, camera.grab(5.0)) for _ in range(stale + 2)]

    assert began[:stale] == pytest.approx([first + (n + 1) / 30.0 for n in range(stale)], abs=1e-6)
    assert began[stale] >= back_s
    assert began[stale + 1] == pytest.approx(began[stale] + 1.0 / 30.0, abs=1e-6)


def test_nothing_is_rendered_that_nobody_looks_at(
    make_camera: MakeCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = make_camera(rate=20.0)
    rendered: list[object] = []
    picture = Stage.picture

    def counted(stage: Stage, moment: Any, settings: Any) -> Any:
        rendered.append(moment)
        return picture(stage, moment, settings)

    monkeypatch.setattr(Stage, "picture", counted)
    frames = [camera.grab(5.0) for _ in range(10)]
    assert not rendered
    mean_of(frames[3])
    assert len(rendered) == 1


def test_a_picture_is_a_jpeg_of_the_moment_it_was_exposed(make_camera: MakeCamera) -> None:
    camera = make_camera()
    before = camera.grab(5.0)
    camera.world.light = 0.0
    while mean_of(frame := camera.grab(5.0)) > 3.0:
        assert begun_s(camera, frame) < begun_s(camera, before) + 1.0, "the light never went out"

    assert mean_of(before) > 10.0
    assert isinstance(before.data() if callable(before.data) else None, bytes)


def test_a_camera_without_time_stamps_gives_none(make_camera: MakeCamera) -> None:
    camera = make_camera(has_timestamps=False)

    assert camera.grab(5.0).exposed_s is None
    assert not camera.facts.has_timestamps


def test_controls_are_what_the_camera_made_of_them(make_camera: MakeCamera) -> None:
    camera = make_camera(fps=50.0)

    assert camera.set_control(ControlName.EXPOSURE, 1e9).value == pytest.approx(20_000.0)
    assert camera.set_control(ControlName.GAIN, 2.5).value == 2.5
    assert camera.controls()[ControlName.GAIN].value == 2.5
    assert ControlName.BRIGHTNESS not in camera.controls()
    for name, value in ((ControlName.BRIGHTNESS, 1.0), (ControlName.GAIN, math.nan)):
        with pytest.raises(DeviceRefused):
            camera.set_control(name, value)


def test_its_own_automatic_exposes_longer_in_the_dark(make_camera: MakeCamera) -> None:
    camera = make_camera()
    bright = camera.set_control(ControlName.EXPOSURE, None)
    camera.world.light = 0.5
    dim = camera.set_control(ControlName.EXPOSURE, None)

    assert bright.is_automatic
    assert dim.is_automatic
    assert bright.value is not None
    assert dim.value == pytest.approx(2.0 * bright.value)
    assert not camera.set_control(ControlName.EXPOSURE, 5000.0).is_automatic


def test_a_control_acts_on_pictures_exposed_afterwards(make_camera: MakeCamera) -> None:
    camera = make_camera(camera_latency_s=0.1)
    plain = mean_of(camera.grab(5.0))
    set_s = camera.world.clock.now_s()
    camera.set_control(ControlName.GAIN, 4.0)
    frames = [camera.grab(5.0) for _ in range(8)]
    is_after = [begun_s(camera, frame) >= set_s for frame in frames]

    assert True in is_after
    assert False in is_after
    for frame, is_bright in zip(frames, is_after, strict=True):
        assert mean_of(frame) == pytest.approx(4.0 * plain if is_bright else plain, rel=0.1)


def test_an_unplugged_camera_is_lost_until_it_is_back(make_camera: MakeCamera) -> None:
    camera = make_camera()
    camera.unplug()
    with pytest.raises(DeviceLost):
        camera.grab(1.0)
    with pytest.raises(DeviceNotFound):
        camera.connect()
    camera.plug_in()
    with pytest.raises(DeviceLost):
        camera.grab(1.0)
    camera.connect()
    assert mean_of(camera.grab(5.0)) > 10.0


def test_a_frozen_camera_gives_nothing_until_it_is_opened_again(make_camera: MakeCamera) -> None:
    camera = make_camera()
    camera.freeze()
    with pytest.raises(DeviceTimeout):
        camera.grab(0.1)
    camera.disconnect()
    camera.connect()
    assert mean_of(camera.grab(5.0)) > 10.0


def test_a_disconnected_camera_says_so(make_camera: MakeCamera) -> None:
    camera = make_camera()
    camera.disconnect()
    for ask in (lambda: camera.grab(0.1), camera.controls):
        with pytest.raises(DeviceError, match="not connected"):
            ask()
