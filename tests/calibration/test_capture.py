"""Calibration pictures take themselves on a small, fast simulated bench."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.calibration.capture import CapturePlan, capture
from app.calibration.capture_camera import CameraLimits
from app.calibration.capture_events import Ask, CaptureEvent, EventKind, Request, Task, simulated_hands
from app.calibration.capture_goals import Goals, Stance, usual_camera
from app.calibration.capture_session import CaptureSession
from app.calibration.capture_solve import calibrate_captured
from app.calibration.plan import CalibrationPlan
from app.calibration.proof import Verdict, prove
from app.calibration.views import gather
from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.errors import CalibrationError, OptionError, OutputError
from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.recording.reader import Recording
from app.recording.shot import Role
from app.simulation.world import SimulatedWorld
from app.vision.board import BoardObservation, BoardSpec
from app.vision.stripe import STRIPE_DETECTORS
from benchmarks.synthetic_views import surface_error_mm

_SIZE = (640, 480)
_BOARD = BoardSpec("chessboard", 9, 6, 10.0)
_TABLE_ONLY = CapturePlan(with_camera=False, placements=1, with_proof=False, with_empty_table=False)


class _Watching:
    """Notes what happens, and fails or acts when it is told to."""

    def __init__(self) -> None:
        self.events: list[CaptureEvent] = []
        self.fails_at: tuple[EventKind, int] | None = None

    def __call__(self, event: CaptureEvent) -> None:
        self.events.append(event)
        if self.fails_at == (event.kind, self.count(event.kind)):
            raise KeyboardInterrupt

    def count(self, kind: EventKind) -> int:
        return sum(event.kind is kind for event in self.events)


@contextmanager
def _bench(dialect: str = "horus", **simulation: object) -> Iterator[tuple[Bench, SimulatedWorld, Ask]]:
    options: dict[str, object] = {"width": 480, "height": 360, "rate": 8.0}
    with Bench.build(simulated_description(dialect, **(options | simulation))) as bench:
        bench.connect()
        assert bench.world is not None
        yield bench, bench.world, simulated_hands(bench.world)


def _is_safe(world: SimulatedWorld) -> bool:
    return not world.plant.at(world.clock.now_s()).outputs_on


def _stance(x: float, y: float, z: float, about_x_deg: float = 0.0, about_y_deg: float = 0.0) -> Stance:
    points = _BOARD.points()
    rotation = rotation_from_rvec(np.radians([about_x_deg, about_y_deg, 0.0]))
    pose = RigidTransform(rotation, np.array([x, y, z]) - rotation @ points.mean(axis=0))
    corners = usual_camera(_SIZE).project(pose @ points)
    # Without any noise OpenCV finds no pose of a board that is turned about a line of its own.
    corners += np.random.default_rng(0).normal(size=corners.shape) * 0.03
    return Stance.of(BoardObservation(np.arange(len(points)), corners, points), _SIZE)


@pytest.mark.parametrize(
    ("about", "side"),
    [
        ((30.0, 0.0), "bottom"),
        ((-30.0, 0.0), "top"),
        ((0.0, 30.0), "left side"),
        ((0.0, -30.0), "right side"),
    ],
)
def test_the_side_that_is_tilted_away_is_named_as_it_is_seen(about: tuple[float, float], side: str) -> None:
    points = _BOARD.points() - _BOARD.points().mean(axis=0)
    depth = (rotation_from_rvec(np.radians([*about, 0.0])) @ points.T)[2]
    way = {
        "top": -points[:, 1],
        "bottom": points[:, 1],
        "left side": -points[:, 0],
        "right side": points[:, 0],
    }
    assert float(depth @ way[side]) > 0.0
    assert _stance(0.0, 0.0, 300.0, *about).tilted_away == {side}


def test_the_same_view_twice_adds_nothing() -> None:
    goals = Goals(_SIZE)
    first = _stance(0.0, 0.0, 300.0)
    assert goals.gain(first)
    goals.add(first)
    assert not goals.gain(_stance(1.0, 1.0, 301.0, 2.0))
    assert "more of the picture" in goals.gain(_stance(50.0, 0.0, 300.0))


def test_what_is_wanted_is_what_is_missing() -> None:
    goals = Goals(_SIZE)
    assert "whole board" in goals.wanted
    goals.add(_stance(0.0, 0.0, 300.0))
    assert goals.wanted == "tilt the top of the board away from the camera"
    for about in ((-30.0, 0.0), (30.0, 0.0), (0.0, 30.0), (0.0, -30.0)):
        goals.add(_stance(40.0, 0.0, 300.0, *about))
    assert "left" in goals.wanted
    for x in (-70.0, -30.0, 0.0, 30.0, 70.0):
        for y in (-50.0, 0.0, 50.0):
            goals.add(_stance(x, y, 300.0))
    assert goals.coverage > 0.7
    assert "camera" in goals.wanted
    goals.add(_stance(0.0, 0.0, 500.0))
    assert goals.wanted == ""
    assert goals.done == 1.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Recording, _Watching, SimulatedWorld]:
    """Everything, captured once."""
    watching = _Watching()
    with _bench() as (bench, world, hands):
        captured = capture(
            bench,
            tmp_path_factory.mktemp("captured") / "rig",
            world.stage.board,
            hands,
            watching,
            CapturePlan(),
        )
        assert _is_safe(world)
        assert bench.snapshot().holder == ""
    assert captured.proof is not None
    return captured.recording, captured.proof, watching, world


def test_every_kind_of_view_is_taken_and_told(
    whole: tuple[Recording, Recording, _Watching, SimulatedWorld],
) -> None:
    recording, proof, watching, _ = whole
    assert len(recording.select(Role.INTRINSICS)) >= 12
    for pose in (0, 1):
        mine = [entry for entry in recording.select(Role.AXIS) if entry.pose == pose]
        angles = {entry.angle_deg for entry in mine}
        assert 5 <= len(angles) <= 7
        assert {entry.lasers_on for entry in mine} == {(), ("left",), ("right",)}
        assert len(mine) == 3 * len(angles)
    new = {entry.angle_deg for entry in proof.entries}
    assert len(new) >= 4
    assert not new & {entry.angle_deg for entry in recording.select(Role.AXIS) if entry.pose == 1}
    assert all(entry.lasers_on for entry in recording.select(Role.BACKGROUND))
    taken = [event for event in watching.events if event.kind is EventKind.TAKEN]
    assert {event.stage for event in taken} == {"camera", "board", "proof", "table"}
    assert all(event.words for event in watching.events)
    assert watching.count(EventKind.WANTED) >= 2


def test_it_calibrates_to_the_truth_and_the_proof_agrees(
    whole: tuple[Recording, Recording, _Watching, SimulatedWorld],
) -> None:
    recording, proof, _, world = whole
    detector = STRIPE_DETECTORS.make("zero-crossing")
    outcome = calibrate_captured(recording, detector, CalibrationPlan())
    assert not outcome.doubts
    assert surface_error_mm(world.rig, outcome.record.rig) < 0.08
    found = prove(gather([proof], detector), outcome.record)
    assert found.verdict is not Verdict.BAD
    assert found.points > 200


def test_a_known_camera_needs_no_camera_views_and_one_placement_may_do(tmp_path: Path) -> None:
    asked: list[Request] = []
    with _bench() as (bench, world, hands):

        def ask(request: Request) -> None:
            asked.append(request)
            hands(request)

        captured = capture(bench, tmp_path / "rig", world.stage.board, ask, _Watching(), _TABLE_ONLY)
    assert captured.proof is None
    assert [request.task for request in asked] == [Task.PLACE_BOARD]
    assert not captured.recording.select(Role.INTRINSICS)


def test_what_was_taken_is_kept_and_gone_on_with(tmp_path: Path) -> None:
    watching = _Watching()
    watching.fails_at = (EventKind.TAKEN, 3)
    plan = _TABLE_ONLY
    with _bench() as (bench, world, hands):
        with pytest.raises(KeyboardInterrupt):
            capture(bench, tmp_path / "rig", world.stage.board, hands, watching, plan)
        assert _is_safe(world)
        assert len(Recording.open(tmp_path / "rig").entries) == 9
        with pytest.raises(OutputError, match="not empty"):
            capture(bench, tmp_path / "rig", world.stage.board, hands, _Watching(), plan)
        captured = capture(bench, tmp_path / "rig", world.stage.board, hands, _Watching(), plan, resumes=True)
    poses = [entry.pose for entry in captured.recording.entries]
    assert poses[:9] == [0] * 9
    assert set(poses[9:]) == {1}
    assert len(poses) >= 9 + 15


def test_nothing_is_left_where_nothing_was_taken(tmp_path: Path) -> None:
    def refuse(request: Request) -> None:
        raise KeyboardInterrupt

    with _bench() as (bench, world, _), pytest.raises(KeyboardInterrupt):
        capture(bench, tmp_path / "rig", world.stage.board, refuse, _Watching(), CapturePlan())
    assert not (tmp_path / "rig").exists()


def test_a_board_that_is_unplugged_for_a_moment_costs_no_picture(tmp_path: Path) -> None:
    watching = _Watching()
    with _bench() as (bench, world, hands):

        def unplug(event: CaptureEvent) -> None:
            watching(event)
            if event.kind is EventKind.TAKEN and watching.count(EventKind.TAKEN) == 2:
                world.port.unplug()
            if event.kind is EventKind.WAITING:
                world.port.plug_in()

        captured = capture(bench, tmp_path / "rig", world.stage.board, hands, unplug, _TABLE_ONLY)
        assert _is_safe(world)
    assert watching.count(EventKind.GOING_ON) >= 1
    assert len(captured.recording.entries) >= 6 + 15


def test_a_board_that_is_nowhere_is_asked_for_again_and_then_given_up(tmp_path: Path) -> None:
    asked: list[str] = []
    with _bench(rate=60.0) as (bench, world, _):
        world.put("nothing")
        with pytest.raises(CalibrationError, match="not seen at any angle"):
            capture(
                bench, tmp_path / "rig", world.stage.board, lambda request: asked.append(request.words),
                _Watching(), _TABLE_ONLY,
            )  # fmt: skip
    assert len(asked) > 1
    assert "not seen" in asked[1]


def test_a_person_may_say_that_it_is_enough_but_not_too_soon(tmp_path: Path) -> None:
    plan = CapturePlan(limits=CameraLimits(is_enough=lambda: True))
    with _bench() as (bench, world, hands), pytest.raises(CalibrationError, match="Only 0 views"):
        capture(bench, tmp_path / "rig", world.stage.board, hands, _Watching(), plan)


def test_a_bench_without_lasers_is_refused_before_anything_moves(tmp_path: Path) -> None:
    plain = simulated_description("horus", width=480, height=360, rate=8.0)
    with Bench.build(plain.model_copy(update={"lasers": ()})) as bench:
        bench.connect()
        with pytest.raises(OptionError, match="no laser"):
            capture(bench, tmp_path / "rig", _BOARD, lambda request: None, _Watching(), _TABLE_ONLY)
    assert not CaptureSession.is_begun(tmp_path / "rig")
