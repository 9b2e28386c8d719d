"""A folder of calibrations: one dated file each, one of them in use, and a bin for those taken out."""

from dataclasses import dataclass
from pathlib import Path

from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError, OutputError
from app.files import make_folder, reason, write_whole

STORE = Path("calibration_store")
"""Where calibrations are kept, in the folder that a command runs in."""
_CURRENT = "current"
_BIN = "bin"
# The longest name that a file system takes.
_LONGEST_NAME = 255
_EMPTY_HINT = "Make one with `turnscan calibrate`, or name a file with --calibration."
_WHICH_HINT = "`turnscan calibrations list` shows their names; the beginning of one will do."
_CHOOSE_HINT = "Choose one with `turnscan calibrations use`."


@dataclass(frozen=True, eq=False, slots=True)
class KeptCalibration:
    """One file of the store.

    Attributes:
        path: where it is; its stem is its name.
        record: what it holds; None where it cannot be read.
        problem: why it cannot.
        is_current: whether it is the one in use.
    """

    path: Path
    record: CalibrationRecord | None
    problem: str
    is_current: bool

    @property
    def name(self) -> str:
        return self.path.stem


class CalibrationStore:
    """Calibrations in a folder.

    Attributes:
        folder: made when the first one is saved.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def save(self, record: CalibrationRecord, *, is_current: bool = True) -> Path:
        """Keep a calibration under its date; the file.

        Args:
            record: what to keep.
            is_current: use it from now on; if not, the one in use stays, where there is one.
        """
        make_folder(self.folder)
        before = self.paths()
        if not is_current and before and self._chosen() is None:
            self._choose(before[-1])
        path = _free(self.folder, f"{record.created:%Y-%m-%dT%H-%M-%SZ}")
        record.save(path)
        if is_current:
            self._choose(path)
        return path

    def paths(self) -> tuple[Path, ...]:
        """Files of all calibrations, oldest first."""
        return _documents(self.folder)

    def removed(self) -> tuple[Path, ...]:
        """Files of those in the bin, oldest first."""
        return _documents(self.folder / _BIN)

    def kept(self, *, in_bin: bool = False) -> tuple[KeptCalibration, ...]:
        """All calibrations, or all in the bin, oldest first; one that cannot be read hides no other."""
        if in_bin:
            return tuple(_kept(path, is_current=False) for path in self.removed())
        try:
            current: Path | None = self.current_path()
        except CalibrationFileError:
            current = None
        return tuple(_kept(path, is_current=path == current) for path in self.paths())

    def current_path(self) -> Path:
        """File of the calibration in use: the chosen one, else the newest.

        Raises:
            CalibrationFileError: there is none, or the chosen one has gone.
        """
        chosen = self._chosen()
        if chosen is None:
            paths = self.paths()
            if not paths:
                raise CalibrationFileError(str(self.folder), "holds no calibration yet", _EMPTY_HINT)
            return paths[-1]
        if chosen not in self.paths():
            raise CalibrationFileError(
                str(self.folder / _CURRENT), f"names {chosen.name}, which is not there", _CHOOSE_HINT
            )
        return chosen

    def current(self) -> CalibrationRecord:
        """The calibration to use.

        Raises:
            CalibrationFileError: there is none, or it cannot be read.
        """
        return CalibrationRecord.load(self.current_path())

    def find(self, name: str) -> Path:
        """The file of a name, of the beginning of one if no other begins so, or of `current`.

        Raises:
            CalibrationFileError: there is none, or several.
        """
        if name == _CURRENT:
            return self.current_path()
        return _only(name, self.paths(), str(self.folder))

    def use(self, name: str) -> Path:
        """Use this one from now on; one that is in the bin comes back. The file.

        Raises:
            CalibrationFileError: there is no such calibration, or it cannot be read.
            OutputError: the choice cannot be written.
        """
        try:
            path = self.find(name)
        except CalibrationFileError:
            in_bin = [path for path in self.removed() if path.stem.startswith(_stem(name))]
            if len(in_bin) != 1:
                raise
            CalibrationRecord.load(in_bin[0])
            path = _moved(in_bin[0], self.folder)
        CalibrationRecord.load(path)
        self._choose(path)
        return path

    def remove(self, name: str) -> Path:
        """Put a calibration and its report into the bin, from which `use` takes it back; where it is now.

        If it was in use, the newest of the others is.

        Raises:
            CalibrationFileError: there is no such calibration.
            OutputError: it cannot be moved.
        """
        path = self.find(name)
        was_chosen = self._chosen() == path
        make_folder(self.folder / _BIN)
        moved = _moved(path, self.folder / _BIN)
        if was_chosen:
            (self.folder / _CURRENT).unlink(missing_ok=True)
        return moved

    def restore(self, name: str) -> Path:
        """Take a calibration back from the bin; the one in use stays. The file.

        Raises:
            CalibrationFileError: the bin holds none of that name, or it cannot be read.
            OutputError: it cannot be moved.
        """
        path = _only(name, self.removed(), str(self.folder / _BIN))
        CalibrationRecord.load(path)
        if self._chosen() is None and self.paths():
            # The newest is in use, which the one that comes back may be.
            self._choose(self.paths()[-1])
        return _moved(path, self.folder)

    def _chosen(self) -> Path | None:
        """The file that somebody chose; None where nobody did."""
        note = self.folder / _CURRENT
        try:
            with note.open("rb") as file:
                name = file.read(_LONGEST_NAME + 2).decode("utf-8", "replace").strip()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise CalibrationFileError(str(note), reason(error), _CHOOSE_HINT) from error
        if not name or "\0" in name or Path(name).name != name:
            raise CalibrationFileError(str(note), "does not name a calibration", _CHOOSE_HINT)
        return self.folder / name

    def _choose(self, path: Path) -> None:
        write_whole(self.folder / _CURRENT, f"{path.name}\n".encode())


def _documents(folder: Path) -> tuple[Path, ...]:
    """No links: what is shown and sent is what lies in the folder itself."""
    found = (path for path in folder.glob("[!.]*.json") if not path.is_symlink())
    return tuple(sorted(found, key=lambda path: path.stem))


def _kept(path: Path, *, is_current: bool) -> KeptCalibration:
    try:
        return KeptCalibration(path, CalibrationRecord.load(path), "", is_current)
    except CalibrationFileError as error:
        return KeptCalibration(path, None, error.problem, is_current)


def _stem(name: str) -> str:
    """As people type it: with the ending of the file or without."""
    return name.removesuffix(".json")


def _only(name: str, paths: tuple[Path, ...], where: str) -> Path:
    stem = _stem(name)
    exact = [path for path in paths if path.stem == stem]
    found = exact or [path for path in paths if stem and path.stem.startswith(stem)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise CalibrationFileError(where, f"holds no calibration {name!r}", _WHICH_HINT)
    raise CalibrationFileError(
        where, f"holds {len(found)} calibrations that begin with {name!r}", _WHICH_HINT
    )


def _free(folder: Path, stem: str) -> Path:
    """A file of that name that is not there yet, with a number where it must be."""
    path, number = folder / f"{stem}.json", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}.{number:03d}.json"
    return path


def _moved(path: Path, folder: Path) -> Path:
    """Move a calibration and the reports beside it; where it is now."""
    target = _free(folder, path.stem)
    beside = [path.with_suffix(ending) for ending in (".html", ".png")]
    try:
        path.rename(target)
        for report in beside:
            if report.is_file():
                report.rename(target.with_suffix(report.suffix))
    except OSError as error:
        raise OutputError(str(path), reason(error)) from error
    return target
