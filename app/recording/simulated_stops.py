"""The stops of a simulated recording: which scene, which angle, which frames."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.geometry.transform import RigidTransform, rotation_about
from app.recording.shot import Role
from app.recording.simulated_plan import SimulationPlan
from app.simulation.boards import board_body, board_plate, table_bodies
from app.simulation.poses import fitting_board, free_poses, sheet_poses, standing_pose
from app.simulation.rig import Z_UP
from app.simulation.scene import Body, Scene
from app.vision.board import BoardSpec

_INTRINSICS_EXPOSURE = 2.2


@dataclass(frozen=True, slots=True)
class Take:
    """One frame, and what the recording says of it."""

    role: Role
    lasers_on: tuple[str, ...] = ()
    angle_deg: float | None = None
    pose: int | None = None
    time_s: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Stop:
    """Frames that see the same.

    Attributes:
        scene: what there is.
        angle_rad: where the table truly stands, counter-clockwise.
        takes: the frames.
        camera_from_board: where the board truly is; identity where there is none.
        has_board: whether there is one.
    """

    scene: Scene
    angle_rad: float
    takes: tuple[Take, ...]
    camera_from_board: RigidTransform
    has_board: bool


def board_of(plan: SimulationPlan) -> BoardSpec:
    return fitting_board(plan.scanner.rig) if plan.board is None else plan.board


def calibration_stops(plan: SimulationPlan) -> Iterator[Stop]:
    """Every calibration view: free boards without the table in the way, then boards on the table."""
    rig, board = plan.scanner.rig, board_of(plan)
    plate = board_plate(board)
    lasers = tuple(rig.lasers)
    # No laser has to be seen in these, so nobody would take them in the dark.
    bright = replace(plan, lighting=plan.lighting.brighter(_INTRINSICS_EXPOSURE))
    for pose in free_poses(rig.camera, plate, plan.views.intrinsics, plan.rng("intrinsics")):
        yield _held(bright, board, pose, (Take(Role.INTRINSICS),))
    for number, pose in enumerate(sheet_poses(rig, plate, plan.views.laser_plane, plan.rng("planes"))):
        takes = tuple(
            Take(Role.LASER_PLANE, lit, None, number) for lit in ((), *((name,) for name in lasers))
        )
        yield _held(plan, board, pose, takes)
    yield from _axis_stops(plan, board)
    yield from _axis_line_stops(plan, board)


def scan_stops(plan: SimulationPlan) -> Iterator[Stop]:
    """The empty table, where it is asked for, then the object."""
    scene = _scene(plan, *_table(plan))
    yield from _turn(plan, scene, plan.background_steps, Role.BACKGROUND)
    item = Body(plan.item.mesh, plan.table_from_item, True)
    yield from _turn(plan, replace(scene, bodies=(*scene.bodies, item)), plan.steps, Role.SCAN)


def _turn(plan: SimulationPlan, scene: Scene, steps: int, role: Role) -> Iterator[Stop]:
    is_steady = plan.seconds_per_turn > 0.0
    told = 360.0 * np.arange(steps) / max(steps, 1)
    reached = plan.angle_error.reached_deg(told, plan.rng(role.value))
    seconds = plan.seconds_per_turn / max(steps, 1) if is_steady else 0.4
    for step in range(steps):
        angle_deg = None if is_steady else float(told[step])
        start_s = float(step * seconds)
        lit = [Take(role, (name,), angle_deg, None, start_s) for name in plan.scanning_lasers]
        if is_steady:
            takes = lit
        else:
            takes = [replace(take, time_s=start_s + 0.1 * n) for n, take in enumerate(lit, start=1)]
            if role is Role.SCAN and plan.texture_every and step % plan.texture_every == 0:
                takes.insert(0, Take(Role.TEXTURE, (), angle_deg, None, start_s))
        true_rad = plan.turn_sign * np.radians(float(reached[step]))
        yield Stop(scene, float(true_rad), tuple(takes), RigidTransform.identity(), False)


def _axis_stops(plan: SimulationPlan, board: BoardSpec) -> Iterator[Stop]:
    """A board beside the axis, turned with the table."""
    radius, rng = plan.scanner.table_radius_mm, plan.rng("axis")
    lasers = tuple(plan.scanner.rig.lasers)
    told = np.array(plan.views.angles_deg)
    for number in range(plan.views.placements):
        # In turns before and behind the axis, so that the stripes lie at different depths.
        towards = (0.40 if number % 2 == 0 else -0.28) * radius * (1.0 - 0.1 * (number // 2))
        pose = standing_pose(
            board_plate(board), towards, rng.uniform(-0.1, 0.1) * radius,
            np.radians(rng.uniform(-6.0, 6.0)), np.radians(rng.uniform(2.0, 12.0)),
        )  # fmt: skip
        scene = _scene(plan, *_table(plan), board_body(board, pose, turns=True))
        for angle_deg, reached in zip(told, plan.angle_error.reached_deg(told, rng), strict=True):
            takes = tuple(
                Take(Role.AXIS, lit, float(angle_deg), number) for lit in ((), *((n,) for n in lasers))
            )
            yield _standing(plan, scene, pose, float(plan.turn_sign * np.radians(reached)), takes)


def _axis_line_stops(plan: SimulationPlan, board: BoardSpec) -> Iterator[Stop]:
    """A board through the axis, as well as it was placed by hand, with the laser line along it."""
    rng, views = plan.rng("axis_line"), plan.views
    first = next(iter(plan.scanner.rig.lasers))
    for number in range(views.axis_line):
        turn = np.radians((number - (views.axis_line - 1) / 2.0) * 15.0)
        pose = standing_pose(
            board_plate(board), views.hand_mm * rng.standard_normal(), 0.0,
            np.radians(views.hand_deg) * rng.standard_normal(),
            np.radians(views.hand_deg) * rng.standard_normal(),
        )  # fmt: skip
        scene = _scene(plan, *_table(plan), board_body(board, pose, turns=True))
        takes = (Take(Role.AXIS_LINE, (), None, number), Take(Role.AXIS_LINE, (first,), None, number))
        yield _standing(plan, scene, pose, float(turn), takes)


def _held(plan: SimulationPlan, board: BoardSpec, pose: RigidTransform, takes: tuple[Take, ...]) -> Stop:
    """A board in somebody's hand; at angle 0 the table frame stands still."""
    body = board_body(board, plan.scanner.table_from_camera @ pose, turns=True)
    return Stop(_scene(plan, body), 0.0, takes, pose, True)


def _standing(
    plan: SimulationPlan, scene: Scene, pose: RigidTransform, angle_rad: float, takes: tuple[Take, ...]
) -> Stop:
    turned = RigidTransform(rotation_about(Z_UP, angle_rad), np.zeros(3))
    camera_from_board = plan.scanner.rig.axis.camera_from_table @ turned @ pose
    return Stop(scene, angle_rad, takes, camera_from_board, True)


def _table(plan: SimulationPlan) -> tuple[Body, Body]:
    return table_bodies(plan.scanner.table_radius_mm, plan.platter)


def _scene(plan: SimulationPlan, *bodies: Body) -> Scene:
    return Scene(plan.scanner, bodies, plan.lighting, plan.noise, is_grey=plan.is_grey)
