"""How fast pictures are simulated at 720p: whole recordings, and what a camera sees live."""

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2

from app.geometry.transform import RigidTransform
from app.recording.picture import encode
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan
from app.simulation.boards import board_body, table_bodies
from app.simulation.hands import Hands
from app.simulation.objects import make_object
from app.simulation.poses import fitting_board
from app.simulation.render import Renderer
from app.simulation.rig import SimulatedRig, standard_rig
from app.simulation.scene import Body, Scene
from app.simulation.view import View
from app.vision.markers import PlatterSpec
from benchmarks.report import Row, at_least, at_most

_STEPS, _FULL_STEPS = 30, 400
_WARM_STEPS = 2
_LIMIT_S = 60.0
_PICTURES, _WARM_PICTURES = 60, 4
_TURN_RAD, _PAUSE_S = 0.05, 0.13
_QUALITY = 92
_LEAST_FPS = 15.0
_PLATTER = PlatterSpec("DICT_4X4_50", 12.0, (0, 1, 2, 3, 4, 5))


def run() -> list[Row]:
    return [*_recordings(), *_live()]


def _recordings() -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("mug", "sphere"):
            scan = SimulationPlan(item=make_object(name, None), parts=("scan",), steps=_STEPS)
            # What is compiled and drawn once is not part of the pace.
            once_s = _seconds(replace(scan, steps=_WARM_STEPS), Path(folder) / f"{name}-warm")
            once_s = min(once_s, _seconds(replace(scan, steps=_WARM_STEPS), Path(folder) / f"{name}-short"))
            before_s = time.process_time()
            pace_s = (_seconds(scan, Path(folder) / name) - once_s) / (_STEPS - _WARM_STEPS)
            busy_s = (time.process_time() - before_s) * _FULL_STEPS / _STEPS
            calibration_s = _seconds(replace(scan, parts=("calibration",)), Path(folder) / f"{name}-boards")
            whole_s = once_s + pace_s * (_FULL_STEPS - _WARM_STEPS)
            rows += [
                Row(f"{name}: stops simulated", 1.0 / pace_s, "per second", note="three frames each"),
                at_most(
                    f"{name}: scan of {_FULL_STEPS} steps", whole_s, "s", _LIMIT_S,
                    f"1200 frames, from the pace of {_STEPS} steps",
                ),
                Row(f"{name}: processor time of that scan", busy_s, "s", note="all cores together"),
                at_most(
                    f"{name}: the same with its calibration views", whole_s + calibration_s, "s", _LIMIT_S
                ),
            ]  # fmt: skip
    return rows


def _live() -> list[Row]:
    """What a camera sees live: one laser, noise and JPEG, no two pictures alike."""
    scanner, rows = standard_rig(), []
    for name, platter in (("mug", None), ("rabbit", None), ("mug", _PLATTER)):
        item = Body(make_object(name).mesh, RigidTransform.identity(), True)
        renderer = Renderer(Scene(scanner, (*table_bodies(scanner.table_radius_mm, platter), item)))
        what = f"{name} on a turning {'platter with markers' if platter else 'table'}"
        rows.append(_pace(what, renderer, partial(_turned, renderer)))
    board = fitting_board(scanner.rig)
    hands = Hands.of(scanner.rig, board, across_lasers=False, seed=0)
    renderer = Renderer(Scene(scanner, (board_body(board, RigidTransform.identity(), turns=True),)))
    rows.append(_pace("board in moving hands", renderer, partial(_held, renderer, scanner, hands)))
    return rows


def _turned(renderer: Renderer, number: int) -> View:
    return renderer.look(_TURN_RAD * number)


def _held(renderer: Renderer, scanner: SimulatedRig, hands: Hands, number: int) -> View:
    pose = scanner.table_from_camera @ hands.pose_at(_PAUSE_S * number)
    return renderer.look(0.0, {0: pose})


def _pace(what: str, renderer: Renderer, look: Callable[[int], View]) -> Row:
    """Pictures per second of one core, by the processor time of this thread."""
    threads, times_s = cv2.getNumThreads(), []
    cv2.setNumThreads(1)
    for number in range(_PICTURES):
        start_s = time.thread_time()
        view = look(number)
        picture = renderer.sense(view, {"left": renderer.glow(view, "left")}, number)
        encode(picture, "jpeg", _QUALITY)
        times_s.append(time.thread_time() - start_s)
    cv2.setNumThreads(threads)
    fps = 1.0 / statistics.median(times_s[_WARM_PICTURES:])
    return at_least(f"{what}: pictures by one core", fps, "per second", _LEAST_FPS, "laser, noise and JPEG")


def _seconds(plan: SimulationPlan, folder: Path) -> float:
    start = time.perf_counter()
    simulate_recording(folder, plan)
    return time.perf_counter() - start
