"""The bench: devices one by one, for one job at a time, safe on every way out."""

import threading
from collections.abc import Iterator

import pytest
from turntable_contract import wait_until

from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, simulated_description
from app.devices.cameras.simulated import SimulatedCamera
from app.errors import BenchBusy, BenchFileError, DeviceError, DeviceNotFound, OptionError
from app.simulation.world import SimulatedWorld


def _described(**simulation: object) -> BenchDescription:
    return simulated_description("horus", **({"width": 320, "height": 240, "rate": 20.0} | simulation))


@pytest.fixture
def bench() -> Iterator[Bench]:
    with Bench.build(_described()) as bench:
        bench.connect()
        yield bench


def _world(bench: Bench) -> SimulatedWorld:
    assert bench.world is not None
    return bench.world


def _lit(bench: Bench) -> tuple[str, ...]:
    world = _world(bench)
    return world.plant.lasers_on(world.clock.now_s())


def test_a_laser_is_lit_inside_its_block_only(bench: Bench) -> None:
    with bench.lit("left"):
        assert _lit(bench) == ("left",)
        assert bench.snapshot().lasers_on == ("left",)
        with bench.lit("right"):
            assert _lit(bench) == ("left", "right")
    assert _lit(bench) == ()
    assert bench.snapshot().lasers_on == ()


def test_a_block_that_fails_leaves_no_laser_on(bench: Bench) -> None:
    with pytest.raises(KeyboardInterrupt), bench.lit("left", "right"):
        raise KeyboardInterrupt
    assert _lit(bench) == ()


def test_an_unknown_laser_is_named_with_those_there_are(bench: Bench) -> None:
    with pytest.raises(OptionError, match="'middle'") as told:
        bench.switch("middle", True)
    assert "left, right" in told.value.hint


def test_the_bench_serves_one_job_at_a_time(bench: Bench) -> None:
    with bench.lease("a scan"):
        assert bench.snapshot().holder == "a scan"
        with pytest.raises(BenchBusy, match="a scan"), bench.lease("a checkup", wait_s=0.01):
            pass
    with bench.lease("a checkup"):
        assert bench.snapshot().holder == "a checkup"
    assert bench.snapshot().holder == ""


def test_a_lease_that_ends_badly_makes_all_safe(bench: Bench) -> None:
    def job() -> None:
        with bench.lease("a scan"):
            bench.switch("left", True)
            bench.turntable.start_turning(90.0, 20.0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        job()
    assert _lit(bench) == ()
    world = _world(bench)
    wait_until(lambda: not world.plant.at(world.clock.now_s()).is_moving)


def test_a_job_finds_no_laser_that_somebody_left_on(bench: Bench) -> None:
    bench.switch("left", True)
    with bench.lease("a scan"):
        assert _lit(bench) == ()


def test_an_emergency_stop_from_another_thread_ends_a_move(bench: Bench) -> None:
    world = _world(bench)
    ended: list[BaseException] = []

    def move() -> None:
        try:
            bench.turntable.move_to(720.0)
        except DeviceError as error:
            ended.append(error)

    with bench.lit("left"):
        mover = threading.Thread(target=move, daemon=True)
        mover.start()
        wait_until(lambda: world.plant.at(world.clock.now_s()).is_moving)
        bench.make_safe()
        assert _lit(bench) == ()
        mover.join(10.0)
    assert ended
    assert world.plant.at(world.clock.now_s()).angle_deg < 700.0


def test_a_camera_that_is_missing_does_not_keep_the_table_from_turning() -> None:
    with Bench.build(_described()) as bench:
        camera = bench.camera.driver
        assert isinstance(camera, SimulatedCamera)
        camera.unplug()
        with pytest.raises(DeviceNotFound):
            bench.connect()
        assert bench.turntable.move_to(9.0) == 9.0
        assert any("unplugged" in problem for problem in bench.snapshot().problems)
        camera.plug_in()
        bench.connect()
        assert bench.snapshot().problems == ()


def test_no_laser_is_lit_before_somebody_guards_the_board() -> None:
    with Bench.build(simulated_description("horus")) as bench:
        with pytest.raises(DeviceError, match="not connected yet"):
            bench.switch("left", True)
        bench.connect_turntable()
        bench.switch("left", True)
        assert bench.lasers_on == ("left",)


def test_a_board_that_is_missing_does_not_keep_the_camera_from_seeing() -> None:
    with Bench.build(_described()) as bench:
        _world(bench).port.unplug()
        with pytest.raises(DeviceNotFound):
            bench.connect()
        assert bench.camera.fresh_frame().image().shape == (240, 320, 3)
        assert bench.snapshot().turntable == ""
        _world(bench).port.plug_in()
        bench.connect()
        assert bench.snapshot().turntable.startswith("Horus")


def test_an_emergency_stop_while_the_board_is_being_connected_leaves_it_connected() -> None:
    with Bench.build(_described(rate=4.0)) as bench:
        connecting = threading.Thread(target=bench.connect_turntable, daemon=True)
        connecting.start()
        wait_until(lambda: bench.turntable.is_connected)
        assert bench.snapshot().turntable == ""
        bench.halt()
        connecting.join(60.0)
        assert bench.snapshot().turntable.startswith("Horus")
        bench.switch("left", True)
        assert _lit(bench) == ("left",)


def test_who_lets_go_of_a_camera_that_is_being_opened_does_not_wait_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with Bench.build(_described()) as bench:
        is_opening, may_open = threading.Event(), threading.Event()

        def slowly() -> None:
            is_opening.set()
            assert may_open.wait(60.0)

        monkeypatch.setattr(_world(bench).stage, "rehearse", slowly)
        refused: list[DeviceError] = []

        def connect() -> None:
            try:
                bench.connect_camera()
            except DeviceError as error:
                refused.append(error)

        connecting = threading.Thread(target=connect, daemon=True)
        connecting.start()
        assert is_opening.wait(60.0)
        bench.camera.disconnect()
        may_open.set()
        connecting.join(60.0)
        assert refused
        assert not bench.camera.state.is_connected
        bench.connect_camera()
        assert bench.camera.fresh_frame().image().shape == (240, 320, 3)


def test_disconnecting_puts_the_lasers_out() -> None:
    with Bench.build(_described()) as bench:
        bench.connect()
        world = _world(bench)
        bench.switch("left", True)
    assert not world.plant.at(world.clock.now_s()).outputs_on


@pytest.mark.parametrize(
    ("simulation", "error", "said"),
    [
        ({"obect": "mug"}, BenchFileError, "no option 'obect'"),
        ({"object": "spoon"}, OptionError, "'spoon'"),
        ({"fps": 0.0}, OptionError, "fps"),
        ({"width": "wide"}, BenchFileError, "simulation"),
    ],
)
def test_a_simulation_that_cannot_be_is_named(
    simulation: dict[str, object], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        Bench.build(simulated_description("horus", **simulation))
