"""Rigs, cameras and motions for property tests."""

import numpy as np
from hypothesis import strategies as st

from app.geometry.arrays import Floats
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform, rotation_about

SIZE = (640, 480)
angles = st.floats(-np.pi, np.pi)
lengths = st.floats(-500.0, 500.0)


@st.composite
def directions(draw: st.DrawFn) -> Floats:
    z, turn = draw(st.floats(-1.0, 1.0)), draw(angles)
    radius = np.sqrt(1.0 - z * z)
    return np.array([radius * np.cos(turn), radius * np.sin(turn), z])


@st.composite
def motions(draw: st.DrawFn) -> RigidTransform:
    rotation = rotation_about(draw(directions()), draw(angles))
    return RigidTransform(rotation, np.array([draw(lengths), draw(lengths), draw(lengths)]))


@st.composite
def cameras(draw: st.DrawFn) -> CameraIntrinsics:
    """Webcams whose distortion can be undone over the whole picture."""
    focal = draw(st.floats(600.0, 1500.0))
    matrix = np.array(
        [
            [focal, 0.0, 320.0 + draw(st.floats(-20.0, 20.0))],
            [0.0, focal * draw(st.floats(0.99, 1.01)), 240.0 + draw(st.floats(-20.0, 20.0))],
            [0.0, 0.0, 1.0],
        ]
    )
    distortion = np.array(
        [
            draw(st.floats(-0.25, 0.2)), draw(st.floats(-0.05, 0.1)),
            draw(st.floats(-0.003, 0.003)), draw(st.floats(-0.003, 0.003)), draw(st.floats(-0.02, 0.02)),
        ]
    )  # fmt: skip
    return CameraIntrinsics(matrix, distortion, SIZE)


@st.composite
def pixels(draw: st.DrawFn) -> Floats:
    seed = draw(st.integers(0, 2**32 - 1))
    return np.random.default_rng(seed).uniform([0.0, 0.0], [SIZE[0] - 1.0, SIZE[1] - 1.0], (40, 2))


@st.composite
def axes(draw: st.DrawFn) -> TurntableAxis:
    """A table in front of the camera that it looks down on, by 5 to 60 degrees."""
    tilt, roll = draw(st.floats(np.radians(5.0), np.radians(60.0))), draw(st.floats(-0.1, 0.1))
    up = np.array([np.sin(roll), -np.cos(roll) * np.cos(tilt), -np.cos(roll) * np.sin(tilt)])
    point = np.array(
        [draw(st.floats(-30.0, 30.0)), draw(st.floats(0.0, 60.0)), draw(st.floats(250.0, 500.0))]
    )
    return TurntableAxis(point, up, draw(st.one_of(st.floats(-50.0, 50.0), st.just(float("nan")))))


@st.composite
def rigs(draw: st.DrawFn) -> Rig:
    """One laser from either side, its sheet passing the axis within a few millimetres."""
    axis = draw(axes())
    frame = axis.camera_from_table
    azimuth = draw(st.floats(np.radians(15.0), np.radians(60.0))) * draw(st.sampled_from([-1.0, 1.0]))
    across = frame.rotation @ np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    plane = LaserPlane.through(frame.translation + draw(st.floats(-5.0, 5.0)) * across, across)
    return Rig(draw(cameras()), {"laser": plane}, axis)
