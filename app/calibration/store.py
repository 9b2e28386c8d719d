"""A folder of calibrations, one dated file each, so that any of them can be gone back to."""

from pathlib import Path

from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from app.files import make_folder

STORE = Path("calibration_store")
"""Where calibrations are kept, in the folder that a command runs in."""
_EMPTY_HINT = "Make one with `turnscan calibrate`, or name a file with --calibration."


class CalibrationStore:
    """Calibrations in a folder.

    Attributes:
        folder: made when the first one is saved.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def save(self, record: CalibrationRecord) -> Path:
        """Keep a calibration under its date; the file."""
        make_folder(self.folder)
        stem = f"{record.created:%Y-%m-%dT%H-%M-%SZ}"
        path, number = self.folder / f"{stem}.json", 1
        while path.exists():
            number += 1
            path = self.folder / f"{stem}.{number:03d}.json"
        record.save(path)
        return path

    def paths(self) -> tuple[Path, ...]:
        """Files of all calibrations, oldest first."""
        return tuple(sorted(self.folder.glob("*.json"), key=lambda path: path.stem))

    def newest(self) -> CalibrationRecord:
        """The calibration to use.

        Raises:
            CalibrationFileError: there is none, or it cannot be read.
        """
        paths = self.paths()
        if not paths:
            raise CalibrationFileError(str(self.folder), "holds no calibration yet", _EMPTY_HINT)
        return CalibrationRecord.load(paths[-1])
