"""What another program's calibration holds, and the record it makes for pictures as the bench takes them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from app.calibration.foreign.picture_turn import PictureTurn
from app.calibration.record import CalibrationRecord
from app.devices.frame import Mounting
from app.geometry.arrays import Floats, Matrix3, Vector3
from app.geometry.axis import TurntableAxis
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import LaserPlane
from app.recording.manifest_facts import Direction

_DECIMALS = 3
_HALF_A_DIGIT = 0.5 * 10.0**-_DECIMALS
# A lens and a sensor are mounted better than this.
_MOST_OFF_CENTRE = 0.09
_OTHER_WAY: Mapping[Direction, Direction] = {"ccw": "cw", "cw": "ccw"}


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class ForeignCalibration:
    """A calibration in the frame of the picture that the other program worked with.

    Attributes:
        program: its name.
        camera: for that picture, with the distortion that the program computed points with.
        lens: (5,) the distortion that is in the file.
        uses_lens: whether the program computed points with it.
        turn: what the program did to the sensor's picture.
        lasers: planes by name.
        laser_rms_mm: their residuals, where known.
        missing_lasers: names of those that were not calibrated.
        rotation, translation_mm: camera from platform, z up; None where not calibrated.
        knows_table: whether the platform's origin lies on the table.
        direction: which way the table turns as the program counts angles, seen in its picture.
        notes: what a person should know, beyond what follows from the rest.
    """

    program: str
    camera: CameraIntrinsics
    lens: Floats
    uses_lens: bool
    turn: PictureTurn
    lasers: Mapping[str, LaserPlane]
    laser_rms_mm: Mapping[str, float] = field(default_factory=dict)
    missing_lasers: tuple[str, ...] = ()
    rotation: Matrix3 | None
    translation_mm: Vector3 | None
    knows_table: bool
    direction: Direction
    notes: tuple[str, ...] = ()

    def record(self, file_name: str, bench: Mounting) -> CalibrationRecord:
        """The calibration for pictures as a bench takes them; what it cannot tell is in its notes."""
        seen = PictureTurn.clockwise(bench.rotation, is_mirrored=bench.is_mirrored)
        turn = seen.after(self.turn.inverse())
        camera = turn.camera(self.camera)
        direction = _OTHER_WAY[self.direction] if turn.is_mirrored else self.direction
        axis = None
        if self.rotation is not None and self.translation_mm is not None:
            up = self.rotation[:, 2] / np.linalg.norm(self.rotation[:, 2])
            offset = 0.0 if self.knows_table else math.nan
            axis = TurntableAxis(turn.vector(self.translation_mm), turn.vector(up), offset)
        notes = (
            _about_pictures(camera, bench),
            *self._about_camera(),
            *self._about_lasers(),
            *self._about_table(direction),
            *self.notes,
        )
        return CalibrationRecord(
            camera=camera,
            lasers={name: turn.plane(plane) for name, plane in self.lasers.items()},
            axis=axis,
            laser_rms_mm=self.laser_rms_mm,
            method=self.program.lower(),
            extra={
                "provenance": {
                    "program": self.program,
                    "file": file_name,
                    "turntable_direction": direction,
                    "notes": list(notes),
                }
            },
            source=file_name,
        )

    def _about_camera(self) -> list[str]:
        notes = []
        off = np.abs(self.camera.matrix[:2, 2] / self.camera.size - 0.5).max()
        if off > _MOST_OFF_CENTRE:
            notes.append(
                f"The camera's centre lies {off:.0%} of the picture's size away from its middle: size or "
                "turning of the pictures in the file may not be those it was calibrated with."
            )
        if self.lens.any() and not self.uses_lens:
            notes.append(
                f"{self.program} found a lens distortion of {_edge_px(self.camera, self.lens):.1f} px at the "
                "picture's corner, but computed lasers and points without it. So does this calibration: "
                "with it, the planes would no longer fit. Calibrate again to make use of it."
            )
        if self.uses_lens and _is_rounded(self.lens):
            doubt = _edge_px(self.camera, np.where(self.lens < 0.0, -1.0, 1.0) * _HALF_A_DIGIT)
            notes.append(
                f"{self.program} rounds the lens distortion to {_DECIMALS} decimals, which leaves up to "
                f"{doubt:.2g} px open at the picture's corner."
            )
        return notes

    def _about_lasers(self) -> list[str]:
        notes = [
            f"The plane of laser {name!r} is not in the file: it was not calibrated."
            for name in self.missing_lasers
        ]
        if self.laser_rms_mm:
            notes.append(
                f"The residuals of the laser planes are those of points that {self.program} had chosen for "
                "lying within 0.1 mm: they say little about the truth."
            )
        notes.append(f"{self.program} keeps no uncertainty, so the expected error at the object is unknown.")
        return notes

    def _about_table(self, direction: Direction) -> list[str]:
        if self.rotation is None:
            return ["The axis of the table is not in the file: it was not calibrated."]
        way = "counter-clockwise" if direction == "ccw" else "clockwise"
        turning = (
            f"{self.program} takes it that the table turns {way}, seen from above, as its angles grow: "
            f'direction = "{direction}" in the bench file, if your board counts the same way. '
            "If a scan comes out mirrored, it is the other one; `turnscan doctor` measures it."
        )
        notes = [turning]
        if not self.knows_table:
            notes.append(
                "The height of the table is not in the file (the pattern's distance from the table was left "
                "at 0): heights are counted from the axis point nearest the camera."
            )
        return notes


def camera_of(
    matrix: tuple[float, ...], lens: tuple[float, ...], size: tuple[int, int], *, uses_lens: bool
) -> tuple[CameraIntrinsics, Floats]:
    """The camera as the program computed with it, and the lens distortion as it found it."""
    five = np.zeros(5)
    five[: len(lens)] = lens
    used = five if uses_lens else np.zeros(5)
    return CameraIntrinsics(np.array(matrix, np.float64).reshape(3, 3), used, size), five


def plane_of(normal: tuple[float, ...], distance_mm: float) -> LaserPlane | None:
    """The plane, its normal turned to positive z; None where it was not calibrated."""
    if not any(normal) or distance_mm == 0.0:
        return None
    vector = np.array(normal, np.float64)
    length = float(np.linalg.norm(vector)) * (-1.0 if vector[2] < 0.0 else 1.0)
    return LaserPlane(vector / length, distance_mm / length)


def _about_pictures(camera: CameraIntrinsics, bench: Mounting) -> str:
    width, height = camera.size
    mirror = str(bench.is_mirrored).lower()
    return (
        f"For pictures of {width} x {height}: rotation = {bench.rotation} and mirror = {mirror} in the bench "
        "file. For pictures that are turned in another way, import again and say how."
    )


def _edge_px(camera: CameraIntrinsics, lens: Floats) -> float:
    """How far a distortion moves the corner of the picture that it moves most."""
    bent = replace(camera, distortion=lens)
    width, height = camera.size
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], np.float64)
    rays = replace(camera, distortion=np.zeros(5)).rays(corners)
    return float(np.linalg.norm(bent.project(rays) - corners, axis=1).max())


def _is_rounded(numbers: Floats) -> bool:
    return bool(np.any(numbers)) and bool(np.array_equal(numbers, np.round(numbers, _DECIMALS)))
