"""One published point through the whole chain: pixel, camera, table, turned back."""

import numpy as np
from numpy.testing import assert_allclose

from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.transform import RigidTransform, rotation_about

PIXEL = np.array([[353.21, 231.96]])
IN_CAMERA = np.array([[-24.0089, -77.2663, 270.7843]])
ON_TABLE = np.array([[44.2157, -21.0089, 99.2663]])
TURNED = np.array([[22.4033, -43.5258, 99.2663]])
CAMERA = CameraIntrinsics(
    np.array([[1430.0, 0.0, 480.0], [0.0, 1430.0, 640.0], [0.0, 0.0, 1.0]]), np.zeros(5), (960, 1280)
)
PLANE = LaserPlane(np.array([-0.86952, -0.020884, 0.493456]), 156.11)
# The published table frame: x towards the camera, y to the right, z up; its origin in front of the camera,
# 3 mm to the left, 22 mm below, 315 mm away.
TABLE_FROM_CAMERA = RigidTransform(
    np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([315.0, 3.0, 22.0])
)


def test_the_published_pixel_meets_the_laser_plane_where_it_should() -> None:
    found = PLANE.intersect_rays(CAMERA.rays(PIXEL))
    assert_allclose(found, IN_CAMERA, atol=1e-4)


def test_the_published_point_lies_on_its_ray() -> None:
    assert_allclose(CAMERA.project(IN_CAMERA), PIXEL, atol=1e-3)


def test_the_published_point_moves_to_the_table() -> None:
    assert_allclose(TABLE_FROM_CAMERA @ IN_CAMERA, ON_TABLE, atol=1e-3)
    assert_allclose(TABLE_FROM_CAMERA.inverse() @ ON_TABLE, IN_CAMERA, atol=1e-3)


def test_the_published_point_is_turned_about_the_axis() -> None:
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(-37.35))
    assert_allclose(ON_TABLE @ turn.T, TURNED, atol=1e-3)


def test_the_whole_chain_brings_the_pixel_to_its_place() -> None:
    turn = RigidTransform(rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(-37.35)), np.zeros(3))
    found = turn @ TABLE_FROM_CAMERA @ PLANE.intersect_rays(CAMERA.rays(PIXEL))
    assert_allclose(found, TURNED, atol=1e-3)
