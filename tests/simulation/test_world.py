"""The world that simulated board and camera share: its pictures, its controls and its planted faults."""

import math
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from app.errors import OptionError
from app.geometry.arrays import Floats
from app.simulation.exposure import STANDARD_EXPOSURE_US, SensorSettings
from app.simulation.firmware.motion import ramped_move
from app.simulation.hands import Hands
from app.simulation.history import History
from app.simulation.rig import standard_rig
from app.simulation.world import SimulatedWorld, WorldPlan
from app.vision.board import BoardSpec, detect_board
from app.vision.markers import PlatterSpec
from app.vision.stripe import Image

SMALL = {"dialect": "sardauscan", "width": 320, "height": 180}
PLATTER = PlatterSpec("DICT_4X4_50", 14.0, (0, 1, 2, 3, 4, 5))
THINGS: tuple[Literal["object", "nothing", "board-on-table"], ...] = ("object", "nothing", "board-on-table")
EXPOSED_S = 1e-6 * STANDARD_EXPOSURE_US

MakeWorld = Callable[..., SimulatedWorld]


@pytest.fixture
def make_world(tmp_path: Path) -> Iterator[MakeWorld]:
    with ExitStack() as worlds:

        def make(**options: Any) -> SimulatedWorld:
            plan = WorldPlan(**{**SMALL, **options})
            return worlds.enter_context(SimulatedWorld(plan, Path(tempfile.mkdtemp(dir=tmp_path))))

        yield make


def exposed(world: SimulatedWorld, at_s: float, settings: SensorSettings) -> Image:
    """The picture whose exposure begins then."""
    return world.stage.picture(world.moment(at_s, settings), settings)


def seen(world: SimulatedWorld, after_s: float = 0.0, **settings: float) -> Floats:
    """What the camera sees some time from now, as the machine is going to stand."""
    at_s = world.clock.now_s() + after_s
    return exposed(world, at_s, SensorSettings(**settings)).astype(np.float64)


def turn(world: SimulatedWorld, start_s: float, steps: float, speed: float, from_steps: float = 0.0) -> None:
    world.plant.move(ramped_move(start_s, from_steps, steps, speed, math.inf))


def test_a_picture_shows_the_table_in_the_middle_of_its_exposure(make_world: MakeWorld) -> None:
    world = make_world(platter=PLATTER)
    steps = world.plant.wiring.steps_per_turn
    start_s = world.clock.now_s()
    turn(world, start_s, steps / 10.0, steps)
    turn(world, start_s + 1.0, -steps / 5.0, steps, steps / 10.0)
    settings = SensorSettings(exposure_us=20_000.0)
    standing = exposed(world, start_s - 1.0, settings).astype(np.float64)
    # Half way through the second move the table passes where it stood at the start.
    passing, earlier = (
        exposed(world, start_s + 1.1 - before_s, settings).astype(np.float64) for before_s in (0.01, 0.02)
    )

    assert np.abs(passing - standing).mean() < 0.6 * np.abs(earlier - standing).mean()


def test_a_laser_counts_by_the_share_of_the_exposure_in_which_it_was_lit(make_world: MakeWorld) -> None:
    world = make_world(speckle=0.0)
    world.light = 0.0
    now_s = world.clock.now_s()
    world.plant.switch(0, True, now_s + 1.0)
    settings = SensorSettings()
    none, half, full = (
        float(exposed(world, now_s + 1.0 + s, settings).astype(np.float64)[:, :, 2].sum())
        for s in (-1.5 * EXPOSED_S, -0.5 * EXPOSED_S, 0.0)
    )

    # Read noise that is cut off at black leaves a little light.
    assert (half - none) / (full - none) == pytest.approx(0.5, abs=0.03)


def test_lasers_are_where_the_rig_has_them_unless_they_are_swapped(make_world: MakeWorld) -> None:
    lit = {}
    for is_swapped in (False, True):
        world = make_world(swapped_lasers=is_swapped)
        world.plant.switch(0, True, -1.0)
        lit[is_swapped] = world.plant.lasers_on(0.0)

    assert lit == {False: ("left",), True: ("right",)}


def test_mechanics_may_differ_from_what_the_driver_believes(make_world: MakeWorld) -> None:
    honest, wrong, coarse, loose = (
        make_world(**fault)
        for fault in ({}, {"wrong_direction": True}, {"steps_per_turn": 1000.0}, {"play_deg": 3.0})
    )
    steps = honest.plant.wiring.steps_per_turn
    for world in (honest, wrong, coarse, loose):
        turn(world, 0.0, steps / 36.0, steps)
        turn(world, 5.0, -steps / 36.0, steps, steps / 36.0)
    forth = {world: world.plant.at(4.0).angle_deg for world in (honest, wrong, coarse, loose)}

    assert forth[honest] == pytest.approx(10.0)
    assert forth[wrong] == pytest.approx(-10.0)
    assert forth[coarse] == pytest.approx(10.0 * steps / 1000.0)
    assert forth[loose] == pytest.approx(7.0)
    assert loose.plant.at(9.0).angle_deg == pytest.approx(0.0)


def test_exposure_and_gain_scale_the_picture(make_world: MakeWorld) -> None:
    world = make_world(read_noise=0.0)
    plain = seen(world).mean()

    assert seen(world, exposure_us=2.0 * STANDARD_EXPOSURE_US).mean() == pytest.approx(2.0 * plain, rel=0.01)
    assert seen(world, gain=3.0).mean() == pytest.approx(3.0 * plain, rel=0.01)
    world.light = 0.5
    assert seen(world).mean() == pytest.approx(0.5 * plain, rel=0.02)


def test_gain_brings_noise_that_a_longer_exposure_does_not(make_world: MakeWorld) -> None:
    world = make_world()
    noise = {}
    for name, settings in (
        ("long", SensorSettings(exposure_us=2.0 * STANDARD_EXPOSURE_US)),
        ("gain", SensorSettings(gain=2.0)),
    ):
        one, two = (exposed(world, at_s, settings).astype(np.float64) for at_s in (1.0, 2.0))
        noise[name] = float((one - two).var())

    assert noise["gain"] > 1.8 * noise["long"]


def test_out_of_focus_edges_are_soft(make_world: MakeWorld) -> None:
    world = make_world(platter=PLATTER, speckle=0.0, read_noise=0.0)
    sharp, soft = (np.abs(np.diff(seen(world, focus=focus), axis=1)).max() for focus in (60.0, 120.0))

    assert soft < 0.5 * sharp


def test_white_balance_shifts_between_blue_and_red(make_world: MakeWorld) -> None:
    world = make_world()
    cold, warm = (seen(world, white_balance_k=kelvin).mean(axis=(0, 1)) for kelvin in (3000.0, 8000.0))

    assert cold[0] > warm[0]
    assert cold[2] < warm[2]


def test_a_laser_that_is_too_bright_saturates_until_the_exposure_is_cut(make_world: MakeWorld) -> None:
    fine, bright = make_world(), make_world(saturated=True)
    for world in (fine, bright):
        world.plant.switch(0, True, -1.0)
    normal, glaring, short = seen(fine), seen(bright), seen(bright, exposure_us=400.0)
    clipped = [np.count_nonzero(picture[:, :, 2] == 255.0) for picture in (normal, glaring, short)]

    assert clipped[1] > 300 > 3 * clipped[0]
    assert clipped[2] == 0
    assert short[:, :, 2].max() > 60.0


def test_what_is_put_on_the_table_is_seen(make_world: MakeWorld) -> None:
    world = make_world()
    pictures: dict[str, Floats] = {}
    for thing in THINGS:
        world.put(thing)
        pictures[thing] = seen(world)
    world.place_board(1)
    pictures["elsewhere"] = seen(world)

    # Some hundred pixels at least look different, by more than noise.
    for one, other in (("object", "nothing"), ("object", "board-on-table"), ("board-on-table", "elsewhere")):
        assert np.count_nonzero(np.abs(pictures[one] - pictures[other]).max(axis=2) > 12.0) > 500


def test_a_picture_shows_what_was_there_when_it_was_exposed(make_world: MakeWorld) -> None:
    world = make_world()
    before_s = world.clock.now_s()
    world.put("nothing")
    after = seen(world)
    before = exposed(world, before_s - EXPOSED_S, SensorSettings()).astype(np.float64)

    assert np.count_nonzero(np.abs(after - before).max(axis=2) > 12.0) > 500


def test_the_board_is_found_in_the_hands(make_world: MakeWorld) -> None:
    world = make_world(width=640, height=360, board=BoardSpec("chessboard", 7, 4, 9.0))
    world.hold_board()
    found = 0
    for number in range(6):
        picture = exposed(world, world.clock.now_s() + 1.3 * number, SensorSettings())
        found += bool(len(detect_board(picture, world.stage.board).ids))

    assert found == 6


def test_hands_rest_and_move_without_a_jump() -> None:
    rig = standard_rig().rig
    hands = Hands.of(rig, BoardSpec("chessboard", 9, 6, 8.0), across_lasers=False, seed=1)
    middle = np.array([[32.0, 20.0, 0.0]])
    times = np.arange(0.0, 26.0, 0.01)
    path = np.concatenate([hands.pose_at(float(t)) @ middle for t in times])
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.01

    assert np.count_nonzero(speeds < 1e-6) / len(speeds) == pytest.approx(0.54, abs=0.03)
    # A hand is fast, but it is no machine.
    assert 50.0 < speeds.max() < 1500.0
    assert np.abs(np.diff(speeds)).max() < 0.2 * speeds.max()


def test_hands_hold_the_board_across_every_laser_when_asked() -> None:
    rig, board = standard_rig().rig, BoardSpec("chessboard", 9, 6, 8.0)
    hands = Hands.of(rig, board, across_lasers=True, seed=1)
    for pose in hands.poses:
        for plane in rig.lasers.values():
            ahead = plane.signed_distance(pose @ board.outline())
            assert ahead.min() < 0.0 < ahead.max()


def test_the_same_moment_gives_the_same_picture(make_world: MakeWorld) -> None:
    world = make_world()
    one, two, other = (exposed(world, at_s, SensorSettings()) for at_s in (1.0, 1.0, 1.1))

    assert (one == two).all()
    assert (one != other).any()


def test_a_history_remembers_what_was_so() -> None:
    history = History("first", 5.0)
    for time_s in range(20):
        history.change(f"from {time_s}", float(time_s))

    assert history.at(15.5) == "from 15"
    assert history.at(18.0) == "from 18"
    assert history.last == "from 19"
    # What is forgotten is as the oldest that is not.
    assert history.at(1.0) == history.at(-1e9) == "from 13"


@pytest.mark.parametrize(
    "bad",
    [
        {"width": 3},
        {"fps": 0.0},
        {"rate": math.nan},
        {"jpeg_quality": 101},
        {"play_deg": -1.0},
        {"camera_latency_s": -0.1},
        {"stale_frames": -1},
        {"steps_per_turn": -5.0},
        {"speckle": 2.0},
        {"object": "teapot"},
        {"object_size_mm": 0.0},
        {"dialect": "esperanto"},
        {"board": BoardSpec("chessboard", 1, 6, 8.0)},
    ],
)
def test_a_world_that_cannot_be_is_refused(bad: dict[str, Any], tmp_path: Path) -> None:
    with (
        pytest.raises(OptionError),
        SimulatedWorld(WorldPlan(**{**SMALL, **bad}), tmp_path) as world,
    ):
        world.hold_board()


def test_what_nobody_can_put_or_light_is_refused(make_world: MakeWorld) -> None:
    world = make_world()
    with pytest.raises(OptionError, match="elephant"):
        world.put("elephant")  # type: ignore[arg-type]
    with pytest.raises(OptionError):
        world.light = -1.0
