"""Where a person would hold or stand the board."""

import numpy as np

from app.errors import OptionError
from app.geometry.arrays import Floats, Points, Vector3
from app.geometry.camera import CameraIntrinsics
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_about, rotation_from_rvec
from app.vision.board import BoardSpec

_TRIES = 400
_EDGE_PX = 6.0
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def fitting_board(rig: Rig) -> BoardSpec:
    """A chessboard with 9 x 6 inner corners that fills two fifths of the picture at the axis."""
    width, _ = rig.camera.size
    seen_mm = width * float(np.linalg.norm(rig.axis.origin)) / float(rig.camera.matrix[0, 0])
    return BoardSpec("chessboard", 9, 6, max(0.5, 0.5 * round(0.072 * seen_mm)))


def tipped_pose(vertices: Points, turned: Floats, place: Vector3, tilt_deg: float) -> RigidTransform:
    """Table from object, for one that lies on its side or stands on its head.

    Args:
        vertices: (N, 3) of the object, mm.
        turned: (3, 3) how it is turned about the vertical.
        place: where on the table its middle is; it rests there on its lowest point.
        tilt_deg: how far it is tipped over: 90 for lying, 180 for upside down.
    """
    tipped = turned @ rotation_about(_X, np.radians(tilt_deg))
    corners = vertices @ tipped.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    return RigidTransform(tipped, place - [*(low + high)[:2] / 2.0, low[2]])


def free_poses(
    camera: CameraIntrinsics, plate: Points, count: int, rng: np.random.Generator
) -> list[RigidTransform]:
    """Camera from board: near and far, tilted to all sides, over the whole picture.

    Args:
        camera: the board is wholly in its picture.
        plate: (4, 3) corners of the board, mm.
        count: of poses.
        rng: where and how exactly.
    """
    width, height = camera.size
    middle = plate.mean(axis=0)
    extent = np.ptp(plate, axis=0)
    poses = []
    for number in range(count):
        # A golden-angle spiral of targets covers the picture evenly for any count.
        turn, reach = 2.399963 * number, np.sqrt((number + 0.5) / count)
        target = np.array([0.5 + 0.40 * reach * np.cos(turn), 0.5 + 0.40 * reach * np.sin(turn)])
        fill = 0.42 + 0.45 * ((number * 0.618034) % 1.0)
        for attempt in range(_TRIES):
            slack = 1.0 - attempt / _TRIES
            distance = camera.matrix[1, 1] * extent[1] / (fill * slack * height)
            tilt = np.radians(rng.uniform(12.0, 42.0)) if number % 5 else 0.0
            towards = rng.uniform(0.0, 2.0 * np.pi)
            rotation = rotation_from_rvec(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))
            rotation = rotation @ rotation_about(_Z, np.radians(rng.uniform(-25.0, 25.0)))
            centre = 0.5 + (target - 0.5) * (0.3 + 0.7 * slack)
            ray = camera.rays(centre[None] * [width, height])[0]
            pose = _centred(rotation, middle, ray * distance)
            if _is_inside(camera, pose @ plate):
                poses.append(pose)
                break
        else:
            raise _unfit(extent)
    return poses


def sheet_poses(rig: Rig, plate: Points, count: int, rng: np.random.Generator) -> list[RigidTransform]:
    """Camera from board for laser planes: about the axis, nearer and farther, crossed by every sheet."""
    middle, extent = plate.mean(axis=0), np.ptp(plate, axis=0)
    centre = _nearest_the_optical_axis(rig)
    poses = []
    for number in range(count):
        depth = ((number + 0.5) / count - 0.5) * 0.75 * extent[0]
        for attempt in range(_TRIES):
            slack = 1.0 - attempt / _TRIES
            tilt = np.radians(rng.uniform(8.0, 30.0))
            towards = rng.uniform(0.0, 2.0 * np.pi)
            rotation = rotation_from_rvec(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))
            rotation = rotation @ rotation_about(_Z, np.radians(rng.uniform(-12.0, 12.0)))
            aside = rng.uniform(-0.15, 0.15, 2) * extent[:2]
            pose = _centred(rotation, middle, centre + slack * np.array([*aside, depth]))
            corners = pose @ plate
            if _is_inside(rig.camera, corners) and _are_crossed(rig, corners, pose @ middle[None]):
                poses.append(pose)
                break
        else:
            raise _unfit(extent)
    return poses


def standing_pose(
    plate: Points, towards_camera_mm: float, aside_mm: float, facing_rad: float, lean_rad: float
) -> RigidTransform:
    """Table from board, for a board that stands on the table, facing the camera at table angle 0.

    Args:
        plate: (4, 3) corners of the board, mm, y downwards.
        towards_camera_mm: where its middle stands, along the table's x.
        aside_mm: the same along y.
        facing_rad: turned about the vertical.
        lean_rad: its top leans away from the camera.
    """
    # Board x to the right as the camera sees it (table y), y down, z away from the camera.
    upright = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    rotation = rotation_about(_Z, facing_rad) @ upright @ rotation_about(_X, -lean_rad)
    foot = np.array([plate[:, 0].mean(), plate[:, 1].max(), 0.0])
    return RigidTransform(rotation, np.array([towards_camera_mm, aside_mm, 0.0]) - rotation @ foot)


def _centred(rotation: Points, middle: Vector3, place: Vector3) -> RigidTransform:
    return RigidTransform(rotation, place - rotation @ middle)


def _nearest_the_optical_axis(rig: Rig) -> Vector3:
    """The point of the turntable's axis that is seen nearest the middle of the picture."""
    origin, up = rig.axis.origin, rig.axis.direction
    across = float(up[:2] @ up[:2])
    if across < 1e-3:
        return origin
    nearest: Vector3 = origin - float(origin[:2] @ up[:2]) / across * up
    return nearest


def _is_inside(camera: CameraIntrinsics, corners: Points) -> bool:
    pixels = camera.project(corners)
    high = np.array(camera.size) - 1.0 - _EDGE_PX
    return bool(np.isfinite(pixels).all() and (pixels > _EDGE_PX).all() and (pixels < high).all())


def _are_crossed(rig: Rig, corners: Points, middle: Points) -> bool:
    """Whether every sheet cuts the board well inside, from one long side to the other."""
    for plane in rig.lasers.values():
        ahead = plane.signed_distance(corners)
        if abs(float(plane.signed_distance(middle)[0])) > 0.3 * float(np.ptp(ahead)):
            return False
        if np.count_nonzero(ahead > 0.0) != 2:
            return False
    return True


def _unfit(extent: Vector3) -> OptionError:
    return OptionError(
        f"A board of {extent[0]:g} x {extent[1]:g} mm does not fit into the picture of this rig.",
        "Give a smaller board, or leave it out to get one that fits.",
    )
