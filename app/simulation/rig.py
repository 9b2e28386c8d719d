"""The scanner that is simulated: a calibrated rig, and where its lasers stand."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from app.geometry.arrays import Floats, Vector3, unit
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform
from app.vision.stripe import LaserColour

Z_UP = np.array([0.0, 0.0, 1.0])
_DISTORTION = np.array([-0.12, 0.06, 0.0006, -0.0004, 0.0])


@dataclass(frozen=True, eq=False, slots=True)
class LaserSource:
    """A line laser: a fan of light of finite thickness.

    Attributes:
        position_mm: (3,) where the fan starts, camera frame; lies in the laser's plane.
        colour: of the light.
        sigma_mm: standard deviation of the sheet's Gaussian profile at its focus.
        focus_mm: distance from the source at which the sheet is thinnest.
        focus_depth_mm: distance from the focus at which it has grown by a factor sqrt(2); infinite for a
            sheet of constant thickness.
        half_fan_rad: how far the fan opens to either side of the rig's middle.
        peak_grey: grey levels at the middle of the stripe on a white surface that faces the laser at the
            axis.
    """

    position_mm: Vector3
    colour: LaserColour
    sigma_mm: float
    focus_mm: float
    focus_depth_mm: float = float("inf")
    half_fan_rad: float = 0.6
    peak_grey: float = 230.0


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedRig:
    """The true scanner.

    Attributes:
        rig: camera, laser planes and axis; the axis knows its table.
        sources: one for each laser plane, by the same name.
        table_radius_mm: of the table's disc.
    """

    rig: Rig
    sources: Mapping[str, LaserSource]
    table_radius_mm: float

    @classmethod
    def around(
        cls,
        rig: Rig,
        colours: Mapping[str, LaserColour] | None = None,
        stripe_sigma_px: float = 2.0,
        table_radius_mm: float | None = None,
    ) -> "SimulatedRig":
        """A simulated rig about a calibrated one, with each laser put where one would plausibly stand.

        Every source stands as far from the axis and as high as the camera, in its own plane, on the
        camera's side. A rig whose table is unknown gets one in the lower half of the picture.
        """
        axis = rig.axis if np.isfinite(rig.axis.offset_mm) else _with_table(rig.axis, rig.camera)
        rig = Rig(rig.camera, rig.lasers, axis)
        distance = float(np.linalg.norm(axis.origin))
        sources = {
            name: _source(rig, plane, (colours or {}).get(name, "red"), stripe_sigma_px)
            for name, plane in rig.lasers.items()
        }
        return cls(rig, sources, 0.25 * distance if table_radius_mm is None else table_radius_mm)

    def aimed(self, laser: str, miss_mm: float = 0.0, lean_rad: float = 0.0) -> "SimulatedRig":
        """The same scanner with one laser turned to shine through the axis, or almost.

        Args:
            laser: its name.
            miss_mm: how far beside the axis, where it meets the table.
            lean_rad: how far the sheet leans against the axis there.
        """
        axis, old = self.rig.axis, self.rig.lasers[laser]
        towards = unit(self.sources[laser].position_mm - axis.origin)
        normal = unit(np.cross(axis.direction, towards))
        if normal @ old.normal < 0.0:
            normal = -normal
        outward = np.cross(axis.direction, normal)
        normal = np.cos(lean_rad) * normal + np.sin(lean_rad) * np.cross(outward, normal)
        plane = LaserPlane.through(axis.origin + miss_mm * normal, normal)
        source = self.sources[laser]
        on_plane = source.position_mm - plane.signed_distance(source.position_mm[None])[0] * plane.normal
        return SimulatedRig(
            Rig(self.rig.camera, {**self.rig.lasers, laser: plane}, axis),
            {**self.sources, laser: replace(source, position_mm=on_plane)},
            self.table_radius_mm,
        )

    @property
    def table_from_camera(self) -> RigidTransform:
        """At table angle 0."""
        return self.rig.axis.table_from_camera(0.0)


def standard_rig(
    width: int = 1280,
    height: int = 720,
    *,
    distance_mm: float = 300.0,
    elevation_deg: float = 24.0,
    laser_azimuth_deg: Mapping[str, float] | None = None,
    laser_miss_mm: Mapping[str, float] | None = None,
    laser_lean_deg: Mapping[str, float] | None = None,
    colours: Mapping[str, LaserColour] | None = None,
    stripe_sigma_px: float = 2.0,
    distortion: Floats | None = None,
) -> SimulatedRig:
    """The rig that the figures of the theory are about: f = 1400 px at 720 rows, lasers 30 degrees aside.

    Args:
        width: columns of the picture.
        height: rows; the focal length goes with them.
        distance_mm: from the camera to the point of the axis that it looks at, 25 mm above the table.
        elevation_deg: how far the camera looks down.
        laser_azimuth_deg: where each laser stands about the axis, from the camera, to the right positive.
        laser_miss_mm: how far each sheet passes beside the axis.
        laser_lean_deg: how far each sheet leans against the axis.
        colours: of the lasers; red where not given.
        stripe_sigma_px: how wide a stripe looks on a surface that faces the camera at the axis.
        distortion: (5,) k1, k2, p1, p2, k3.
    """
    azimuths = {"left": -30.0, "right": 30.0} if laser_azimuth_deg is None else dict(laser_azimuth_deg)
    misses = {"left": 1.1, "right": -0.8} if laser_miss_mm is None else dict(laser_miss_mm)
    leans = {"left": 0.5, "right": -0.35} if laser_lean_deg is None else dict(laser_lean_deg)
    scale = height / 720.0
    camera = CameraIntrinsics(
        np.array(
            [
                [1400.0 * scale, 0.0, width / 2.0 - 0.5 + 7.3 * scale],
                [0.0, 1402.5 * scale, height / 2.0 - 0.5 - 5.2 * scale],
                [0.0, 0.0, 1.0],
            ]
        ),
        _DISTORTION.copy() if distortion is None else np.asarray(distortion, np.float64),
        (width, height),
    )
    table_from_camera = _looking_at_the_axis(distance_mm, np.radians(elevation_deg))
    camera_from_table = table_from_camera.inverse()
    axis = TurntableAxis(
        camera_from_table.translation + 25.0 * camera_from_table.rotation[:, 2],
        camera_from_table.rotation[:, 2],
        -25.0,
    )
    lasers = {}
    for name, azimuth_deg in azimuths.items():
        azimuth = np.radians(azimuth_deg)
        outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        lean = np.radians(leans.get(name, 0.0))
        normal = np.cos(lean) * across + np.sin(lean) * np.cross(outward, across)
        point = misses.get(name, 0.0) * across
        lasers[name] = LaserPlane.through(
            camera_from_table.rotation @ point + camera_from_table.translation,
            camera_from_table.rotation @ normal,
        )
    return SimulatedRig.around(Rig(camera, lasers, axis), colours, stripe_sigma_px, table_radius_mm=75.0)


def _looking_at_the_axis(distance_mm: float, elevation: float) -> RigidTransform:
    """Table from camera, for a camera that looks down on the axis 25 mm above the table."""
    back = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    right = np.array([0.0, 1.0, 0.0])
    down = np.cross(-back, right)
    # The camera is not quite where it was meant to be: 1.1 degrees of roll, a little to the side.
    roll = np.radians(1.1)
    x = np.cos(roll) * right + np.sin(roll) * down
    y = np.cross(-back, x)
    position = np.array([0.0, 0.0, 25.0]) + distance_mm * back + 2.5 * right
    return RigidTransform(np.column_stack([x, y, -back]), position)


def _with_table(axis: TurntableAxis, camera: CameraIntrinsics) -> TurntableAxis:
    """The axis with a table where the picture shows the axis about two thirds of the way down."""
    reach = 2.0 * float(np.linalg.norm(axis.origin))
    nearest = float((axis.origin - axis.point_mm) @ axis.direction)
    offsets = nearest + np.linspace(-reach, reach, 2001)
    seen = camera.project(axis.point_mm + offsets[:, None] * axis.direction)
    width, height = camera.size
    off = np.linalg.norm(seen - [0.5 * width, 0.64 * height], axis=1)
    offset_mm = nearest if np.isnan(off).all() else float(offsets[np.nanargmin(off)])
    return TurntableAxis(axis.point_mm, axis.direction, offset_mm)


def _source(rig: Rig, plane: LaserPlane, colour: LaserColour, stripe_sigma_px: float) -> LaserSource:
    origin, up = rig.axis.origin, rig.axis.direction
    foot = origin - plane.signed_distance(origin[None])[0] * plane.normal
    upward = unit(up - (up @ plane.normal) * plane.normal)
    outward = np.cross(upward, plane.normal)
    if outward @ (-foot) < 0.0:
        outward = -outward
    camera_from_axis = -origin - (-origin @ up) * up
    distance = float(np.linalg.norm(camera_from_axis))
    position = foot + distance * outward + float(-origin @ up) * upward
    reach = float(np.linalg.norm(position - origin))
    # One pixel across, on a surface that faces the camera at the axis, is z/f; the sheet cuts it obliquely.
    viewing = unit(origin)
    seen = unit(plane.normal - (plane.normal @ viewing) * viewing)
    mm_per_px = float(np.linalg.norm(origin)) / float(rig.camera.matrix[0, 0])
    sigma_mm = stripe_sigma_px * mm_per_px * abs(float(seen @ plane.normal))
    return LaserSource(position, colour, sigma_mm, reach)
