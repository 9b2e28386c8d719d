"""Printed planes in the simulated picture, where their pose says they are."""

import cv2
import numpy as np
import pytest
from simulated_scenes import on_the_table

from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.simulation.boards import board_body, board_plate, platter_poses
from app.simulation.noise import Noise
from app.simulation.poses import fitting_board, free_poses, sheet_poses, standing_pose
from app.simulation.render import Renderer
from app.simulation.rig import SimulatedRig, standard_rig
from app.simulation.scene import Lighting, Scene
from app.vision.board import BoardSpec, detect_board
from app.vision.markers import PlatterSpec, detect_markers
from app.vision.stripe import Image

BOARDS = {
    "chessboard": BoardSpec("chessboard", 9, 6, 10.0),
    "charuco": BoardSpec("charuco", 7, 5, 15.0, 11.0, "DICT_4X4_50"),
    "circles": BoardSpec("circles", 8, 6, 11.0),
    "asymmetric_circles": BoardSpec("asymmetric_circles", 4, 9, 9.0),
}


@pytest.fixture(scope="module")
def scanner() -> SimulatedRig:
    return standard_rig()


def picture(scanner: SimulatedRig, spec: BoardSpec, pose: RigidTransform) -> Image:
    body = board_body(spec, scanner.table_from_camera @ pose, turns=True)
    scene = Scene(scanner, (body,), Lighting().brighter(2.2), Noise.none())
    renderer = Renderer(scene)
    return renderer.expose(renderer.look(0.0), (), 0)


@pytest.mark.parametrize("kind", BOARDS)
def test_a_board_is_seen_where_it_is(scanner: SimulatedRig, kind: str) -> None:
    spec = BOARDS[kind]
    middle = board_plate(spec).mean(axis=0)
    rotation = rotation_from_rvec(np.array([0.25, -0.3, 0.1]))
    pose = RigidTransform(rotation, np.array([4.0, -3.0, 290.0]) - rotation @ middle)

    seen = detect_board(picture(scanner, spec, pose), spec)

    assert len(seen.ids) == len(spec.points())
    expected = scanner.rig.camera.project(pose @ seen.board_points)
    off = seen.corners - expected
    # Dots show how true the picture is; corners also how well they are found, between markers least well.
    allowed = {"chessboard": 0.05, "charuco": 0.1}.get(kind, 0.02)
    assert float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) < allowed
    assert float(np.abs(off.mean(axis=0)).max()) < 0.6 * allowed


def test_opencv_refines_chessboard_corners_without_bias(scanner: SimulatedRig) -> None:
    spec = BOARDS["chessboard"]
    offs = []
    for pose in free_poses(scanner.rig.camera, board_plate(spec), 4, np.random.default_rng(1)):
        grey = cv2.cvtColor(picture(scanner, spec, pose), cv2.COLOR_BGR2GRAY)
        expected = scanner.rig.camera.project(pose @ spec.points())
        start = np.rint(expected).astype(np.float32).reshape(-1, 1, 2)
        corners = cv2.cornerSubPix(grey, start, (7, 7), (-1, -1), (3, 100, 1e-4))
        # cornerSubPix itself misses the corners of sharper pictures by more.
        offs.append(np.asarray(corners, np.float64).reshape(-1, 2) - expected)
    off = np.concatenate(offs)

    assert float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) < 0.05
    assert float(np.abs(off.mean(axis=0)).max()) < 0.01


def test_markers_on_the_table_are_seen_where_they_are(scanner: SimulatedRig) -> None:
    platter = PlatterSpec("DICT_4X4_50", 12.0, tuple(range(6)))
    renderer = Renderer(on_the_table(scanner, platter=platter))
    seen = detect_markers(renderer.expose(renderer.look(0.0), (), 0), platter)
    half = 6.0
    square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    poses = platter_poses(platter, scanner.table_radius_mm)

    assert len(seen.ids) >= 5
    for number, corners in zip(seen.ids, seen.corners, strict=True):
        expected = scanner.rig.camera.project(scanner.rig.axis.camera_from_table @ poses[number] @ square)
        # How well corners are found is not what is tested here, only which and where.
        assert float(np.median(np.abs(corners - expected))) < 0.7


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (640, 480)])
def test_poses_show_the_whole_board_and_every_sheet_crosses_it(size: tuple[int, int]) -> None:
    scanner = standard_rig(*size)
    spec = fitting_board(scanner.rig)
    plate = board_plate(spec)
    camera = scanner.rig.camera
    free = free_poses(camera, plate, 20, np.random.default_rng(0))
    crossed = sheet_poses(scanner.rig, plate, 10, np.random.default_rng(0))

    for pose in (*free, *crossed):
        pixels = camera.project(pose @ plate)
        assert (pixels > 0.0).all()
        assert (pixels < np.array(size) - 1.0).all()
    for pose in crossed:
        for plane in scanner.rig.lasers.values():
            assert np.count_nonzero(plane.signed_distance(pose @ plate) > 0.0) == 2
    covered = np.concatenate([camera.project(pose @ spec.points()) for pose in free]) / size
    assert (np.ptp(covered, axis=0) > 0.75).all()


def test_a_standing_board_touches_the_table_and_faces_the_camera() -> None:
    plate = board_plate(BOARDS["chessboard"])
    pose = standing_pose(plate, 30.0, 5.0, 0.1, 0.15)
    corners = pose @ plate

    assert abs(float(corners[:, 2].min())) < 1e-9
    assert float(corners[:, 2].max()) > 60.0
    # Into the board is away from the camera, and its top leans that way too.
    assert pose.rotation[0, 2] < -0.9
    assert corners[0, 0] < corners[3, 0]
