"""A calibration file of whatever program, told by what is in it."""

from pathlib import Path

from app.calibration.camera_file import OPENCV_SUFFIXES, parse_opencv
from app.calibration.foreign import fabscan, horus
from app.calibration.record import CalibrationRecord
from app.devices.frame import Mounting
from app.documents import Entry, parse_document
from app.errors import CalibrationFileError
from app.files import reason

MOST_BYTES = 16 * 2**20
"""No calibration is larger."""
_WHICH = "is no calibration of Turnscan, Horus or FabScanPi"
_WHICH_HINT = (
    "Name a calibration file of this program, one that Horus saved (Save calibration), FabScanPi's "
    "config.json, or a camera of OpenCV (.yml, .yaml, .xml)."
)


def import_calibration(path: Path, bench: Mounting | None = None) -> CalibrationRecord:
    """Read a calibration of this program, of Horus or of FabScanPi, or a camera of OpenCV.

    Args:
        path: the file.
        bench: how the bench turns its pictures, for programs that turn them in their own way.

    Raises:
        CalibrationFileError: naming the file and the field.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise CalibrationFileError(str(path), reason(error)) from error
    return parse_calibration(data, str(path), bench or Mounting())


def parse_calibration(data: bytes, source: str, bench: Mounting) -> CalibrationRecord:
    """The bytes of such a file; `source` names it in messages, and its ending tells OpenCV's from JSON.

    Raises:
        CalibrationFileError: naming the source and the field.
    """
    if len(data) > MOST_BYTES:
        raise CalibrationFileError(source, f"is larger than {MOST_BYTES // 2**20} MB")
    if Path(source).suffix.lower() in OPENCV_SUFFIXES:
        return _camera_alone(data, source)
    groups = parse_document(data, Entry, source, CalibrationFileError).unknown
    if "format" in groups:
        return CalibrationRecord.parse(data, source)
    if horus.GROUP in groups:
        found = horus.read_horus(data, source)
    elif fabscan.GROUP in groups:
        found = fabscan.read_fabscan(data, source)
    else:
        raise CalibrationFileError(source, _WHICH, _WHICH_HINT)
    record = found.record(Path(source).name, bench)
    # What is wrong only together, such as a plane through the camera, is found here.
    return CalibrationRecord.parse(record.to_bytes(), source)


def notes_of(record: CalibrationRecord) -> tuple[str, ...]:
    """What the import of a calibration could not know."""
    provenance = record.extra.get("provenance")
    notes = provenance.get("notes") if isinstance(provenance, dict) else None
    return tuple(note for note in notes if isinstance(note, str)) if isinstance(notes, list) else ()


def _camera_alone(data: bytes, source: str) -> CalibrationRecord:
    notes = ["Only the camera is taken from files of OpenCV: laser planes and axis are to be calibrated."]
    return CalibrationRecord(
        camera=parse_opencv(data, source),
        method="opencv",
        extra={"provenance": {"program": "OpenCV", "file": Path(source).name, "notes": notes}},
        source=source,
    )
