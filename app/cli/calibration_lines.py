"""Calibrations and what has changed between two of them, in plain words."""

import math
from collections.abc import Sequence

from app.calibration.compare import Comparison
from app.calibration.record import CalibrationRecord
from app.calibration.store import KeptCalibration
from app.documents import Json

# Beyond which a difference is no accident any more.
_SIGMAS = 2.0


def record_lines(record: CalibrationRecord) -> list[str]:
    """What a calibration holds."""
    width, height = record.camera.size
    fx, fy = record.camera.matrix[0, 0], record.camera.matrix[1, 1]
    lines = [
        f"Made             {record.created:%Y-%m-%d %H:%M} UTC, method {record.method or 'unknown'}",
        f"Camera           {width} x {height}, focal length {fx:.1f} and {fy:.1f} px"
        + _known(", residual {:.3f} px", record.rms_px),
    ]
    for name, plane in record.lasers.items():
        rms = _known(", residual {:.3f} mm", record.laser_rms_mm.get(name, math.nan))
        lines.append(f"Laser {name:<10} {abs(plane.distance_mm):.2f} mm beside the camera's centre{rms}")
    if record.axis is None:
        lines.append("Axis             unknown")
    else:
        away = math.hypot(*record.axis.origin)
        has_table = math.isfinite(record.axis.offset_mm)
        where = "the table's middle" if has_table else "its nearest point"
        lines.append(
            f"Axis             {where} {away:.1f} mm from the camera"
            + _known(", residual {:.3f} mm", record.axis_rms_mm)
        )
        if not has_table:
            lines.append("Table            its height is unknown")
    expected = _known("{:.3f} mm at the object", record.expected_error_mm) or "unknown"
    return [*lines, f"Expected error   {expected}"]


def kept_as_json(kept: KeptCalibration) -> Json:
    """One calibration of the store, for programs."""
    known: Json = {"name": kept.name, "is_current": kept.is_current, "problem": kept.problem}
    record = kept.record
    if record is None:
        return known
    expected = record.expected_error_mm
    return known | {
        "created": f"{record.created:%Y-%m-%dT%H:%M:%SZ}",
        "method": record.method,
        "width": record.camera.size[0],
        "height": record.camera.size[1],
        "lasers": list(record.lasers),
        "has_axis": record.axis is not None,
        "expected_error_mm": expected if math.isfinite(expected) else None,
    }


def missing_for_a_scan(record: CalibrationRecord) -> str:
    """What a scan would need and this calibration lacks; empty where nothing."""
    missing = [] if record.lasers else ["laser plane"]
    missing += ["axis"] if record.axis is None else []
    return " and no ".join(missing)


def comparison_lines(change: Comparison, expected_mm: Sequence[float]) -> list[str]:
    """What has changed, and what it means.

    Args:
        change: second minus first.
        expected_mm: the error that each calibration expects of itself; NaN where unknown.
    """
    camera = change.camera
    along, down = camera.focal_px
    lines = [
        f"Camera           focal length {along:+.2f} and {down:+.2f} px ({camera.focal_percent:+.3f} %)",
        f"Its centre       {camera.centre_px:.2f} px away",
        f"Its distortion   {camera.edge_px:.2f} px different at the picture's edge",
    ]
    for name, plane in change.lasers.items():
        at_axis = _known(", {:+.3f} mm at the axis", plane.at_axis_mm)
        lines.append(f"Laser {name:<10} turned by {plane.angle_deg:.4f} degrees{at_axis}")
    for names, which in ((change.only_first, "first"), (change.only_second, "second")):
        lines += [f"Laser {name:<10} only in the {which}" for name in names]
    if change.axis is None:
        lines.append("Axis             not in both")
    else:
        table = _known(", table {:+.3f} mm higher", change.axis.table_mm)
        lines.append(
            f"Axis             {change.axis.shift_mm:.3f} mm aside, "
            f"tilted by {change.axis.tilt_deg:.4f} degrees{table}"
        )
    return [*lines, *_ball_lines(change, expected_mm)]


def _ball_lines(change: Comparison, expected_mm: Sequence[float]) -> list[str]:
    if not change.ball:
        return ["What that means at the object cannot be told: no laser of both is seen on a ball there."]
    lines = [
        f"Ball, {name:<10} points move by {ball.moved_mm:.3f} mm, "
        f"the shape changes by {ball.bent_mm:.3f} mm (RMS)"
        for name, ball in change.ball.items()
    ]
    verdict = f"A ball of 60 mm would come out {change.bent_mm:.3f} mm different in shape (RMS)"
    expected = math.hypot(*expected_mm)
    if not math.isfinite(expected):
        return [*lines, f"{verdict}."]
    own = f"than the two calibrations' own uncertainty ({expected:.3f} mm) explains"
    if change.bent_mm <= _SIGMAS * expected:
        return [*lines, f"{verdict}: no more {own}."]
    return [*lines, f"{verdict}: more {own}. Something has moved, or one of them is wrong."]


def _known(form: str, number: float) -> str:
    return form.format(number) if math.isfinite(number) else ""
