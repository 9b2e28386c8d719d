"""The simulated camera's process makes the same pictures, may die, and never outlives the program."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest

from app.devices.camera_driver import RawFrame
from app.devices.cameras.simulated import SimulatedCamera
from app.devices.watchdog import Watchdog
from app.errors import DeviceLost
from app.recording.picture import encode
from app.simulation.exposure import SensorSettings
from app.simulation.stage import Moment
from app.simulation.world import SimulatedWorld, WorldPlan

LARGE, SMALL = (640, 480), (160, 96)


def camera_of(world: SimulatedWorld) -> SimulatedCamera:
    camera = SimulatedCamera(world)
    camera.connect()
    return camera


def own_processes() -> list[psutil.Process]:
    ours = psutil.Process().children(recursive=True)
    return [process for process in ours if "app.devices.studio_process" in process.cmdline()]


def file_of(frame: RawFrame) -> bytes:
    assert callable(frame.data)
    data = frame.data()
    assert isinstance(data, bytes)
    return data


@pytest.fixture
def world(tmp_path: Path) -> Iterator[SimulatedWorld]:
    with ExitStack() as stack:
        plan = WorldPlan(dialect="sardauscan", width=LARGE[0], height=LARGE[1])
        yield stack.enter_context(SimulatedWorld(plan, tmp_path))


def test_a_large_picture_is_made_elsewhere_and_is_the_same(
    world: SimulatedWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = camera_of(world)
    assert len(own_processes()) == 1
    begun: list[float] = []
    moment = world.moment

    def noted(at_s: float, settings: SensorSettings) -> Moment:
        begun.append(at_s)
        return moment(at_s, settings)

    monkeypatch.setattr(world, "moment", noted)
    frame = camera.grab(2.0)
    with monkeypatch.context() as only:
        only.setattr(world.stage, "picture", lambda *_: pytest.fail("rendered in the program"))
        made = file_of(frame)
    settings = camera._settings.last
    here = encode(world.stage.picture(moment(begun[0], settings), settings), "jpeg", 92)
    assert made == here


def test_a_small_one_is_not_worth_it(tmp_path: Path) -> None:
    plan = WorldPlan(dialect="sardauscan", width=SMALL[0], height=SMALL[1])
    with SimulatedWorld(plan, tmp_path) as world:
        assert file_of(camera_of(world).grab(2.0)).startswith(b"\xff\xd8")
        assert not own_processes()


def test_pictures_go_on_when_the_process_dies(world: SimulatedWorld) -> None:
    camera = camera_of(world)
    before = camera.grab(2.0)
    (process,) = own_processes()
    process.kill()
    assert file_of(before).startswith(b"\xff\xd8")
    assert file_of(camera.grab(2.0)).startswith(b"\xff\xd8")


def test_a_folder_called_app_is_not_taken_for_ours(
    world: SimulatedWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    camera_of(world)
    assert len(own_processes()) == 1
    with Watchdog() as watchdog:
        watchdog._start()
        time.sleep(1.0)
        assert watchdog.is_running


def test_what_ends_the_program_in_good_order_does_not_take_its_pictures_before(world: SimulatedWorld) -> None:
    camera = camera_of(world)
    (process,) = own_processes()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        process.send_signal(number)
    assert file_of(camera.grab(2.0)).startswith(b"\xff\xd8")
    assert process.is_running()


def test_it_ends_with_the_world_and_nothing_is_rendered_afterwards(world: SimulatedWorld) -> None:
    camera = camera_of(world)
    frame = camera.grab(2.0)
    camera.disconnect()
    camera.connect()
    assert len(own_processes()) == 1
    world.close()
    assert not own_processes()
    with pytest.raises(DeviceLost, match="put away"):
        file_of(frame)


def test_it_ends_when_the_program_is_killed(tmp_path: Path) -> None:
    program = (
        "import time\n"
        "from pathlib import Path\n"
        "from app.devices.cameras.simulated import SimulatedCamera\n"
        "from app.simulation.world import SimulatedWorld, WorldPlan\n"
        f"plan = WorldPlan(dialect='sardauscan', width={LARGE[0]}, height={LARGE[1]})\n"
        f"camera = SimulatedCamera(SimulatedWorld(plan, Path({str(tmp_path)!r})))\n"
        "camera.connect()\n"
        "print(camera._studio._process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        number = int(running.stdout.readline())
        os.kill(running.pid, signal.SIGKILL)
    ends_s = time.monotonic() + 10.0
    while psutil.pid_exists(number) and time.monotonic() < ends_s:
        time.sleep(0.05)
    is_there = psutil.pid_exists(number) and psutil.Process(number).status() != psutil.STATUS_ZOMBIE
    assert not is_there


def test_one_that_comes_too_late_ends_at_once(world: SimulatedWorld) -> None:
    world.close()
    camera_of(world)
    assert not own_processes()
