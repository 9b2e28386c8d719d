import cv2
import numpy as np
from hypothesis import given, settings
from numpy.testing import assert_allclose
from rig_strategies import SIZE, cameras, pixels

from app.geometry.arrays import Floats
from app.geometry.camera import CameraIntrinsics, RayTable


@given(cameras(), pixels())
def test_a_ray_projects_back_to_its_pixel(camera: CameraIntrinsics, seen: Floats) -> None:
    assert_allclose(camera.project(camera.rays(seen) * 321.0), seen, atol=1e-8)


@given(cameras(), pixels())
def test_the_camera_agrees_with_opencv(camera: CameraIntrinsics, seen: Floats) -> None:
    points = camera.rays(seen) * 300.0
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert_allclose(camera.project(points), theirs.reshape(-1, 2), atol=1e-8)


@given(cameras())
def test_a_point_behind_the_lens_has_no_pixel(camera: CameraIntrinsics) -> None:
    behind = np.array([[1.0, 2.0, -100.0], [0.0, 0.0, 0.0]])
    assert np.isnan(camera.project(behind)).all()


def test_the_table_of_rays_is_within_its_promise() -> None:
    camera = CameraIntrinsics(
        np.array([[620.0, 0.0, 320.0], [0.0, 620.0, 240.0], [0.0, 0.0, 1.0]]),
        np.array([-0.2, 0.05, 0.001, -0.002, 0.0]),
        SIZE,
    )
    seen = np.random.default_rng(1).uniform([0, 0], [SIZE[0] - 1, SIZE[1] - 1], (5000, 2))
    seen[:2500, 1] = np.rint(seen[:2500, 1])
    error_mm = 300.0 * np.abs(RayTable.of(camera).at(seen) - camera.rays(seen)[:, :2])
    # theory.md, section 3: below 0.15 um.
    assert error_mm.max() < 0.15e-3


@settings(max_examples=8)
@given(cameras())
def test_the_corners_of_the_picture_are_in_the_table_of_rays(camera: CameraIntrinsics) -> None:
    corners = np.array(
        [[0.0, 0.0], [SIZE[0] - 1.0, 0.0], [0.0, SIZE[1] - 1.0], [SIZE[0] - 1.0, SIZE[1] - 1.0]]
    )
    assert_allclose(RayTable.of(camera).at(corners), camera.rays(corners)[:, :2], atol=1e-6)
