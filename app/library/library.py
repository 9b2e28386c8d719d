"""A folder of scans: list, name, throw away, bring back."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from app.errors import BinChanged, LibraryError, NotThere, OutputError, ScanBusy, ScanNotFound
from app.files import make_folder, reason
from app.library.about import write_about
from app.library.index import Index
from app.library.item import CLOUDS_FOLDER, CloudItem, ScanItem, holds_scan, is_busy
from app.library.log import write_line
from app.library.names import checked_note, checked_title, free_name, inside, slug
from app.library.work import changing, settle, work_folder
from app.library.zip_stream import ZipStream

LIBRARY = Path("scans")
"""Where scans are kept, in the folder that a command runs in."""
BIN_FOLDER = ".bin"
_DELETED = "%Y-%m-%dT%H-%M-%SZ"


@dataclass(frozen=True, slots=True)
class BinItem:
    """A scan that was thrown away.

    Attributes:
        key: what it is called in the bin.
        name: what it was called before.
        deleted: when.
        scan: what it was.
    """

    key: str
    name: str
    deleted: datetime
    scan: ScanItem


@dataclass(frozen=True, slots=True)
class Space:
    """Room on the disk of the library.

    Attributes:
        free_bytes: what is left for this user.
        bin_bytes: what emptying the bin would give back.
        used_bytes: of all scans, the bin left out.
    """

    free_bytes: int
    bin_bytes: int
    used_bytes: int


class Library:
    """Scans in a folder, which several programs may use at once.

    Every change is one renaming: whatever ends the program, a scan is where it was or where it was to go.

    Attributes:
        folder: made when something is put into it.
        upload_bytes: how much may come in over the network at once.
    """

    def __init__(self, folder: Path, upload_bytes: int = 4_000_000_000) -> None:
        self.folder, self.upload_bytes = folder, upload_bytes
        self._index, self._bin = Index(folder), Index(folder / BIN_FOLDER)

    def scans(self) -> tuple[ScanItem, ...]:
        """All of them, newest first. Raises OutputError where the folder cannot be read."""
        items = _read(self._index)
        return tuple(sorted(items, key=lambda item: (item.created, item.name), reverse=True))

    def scan(self, name: str) -> ScanItem:
        """One of them. Raises ScanNotFound."""
        folder = inside(self.folder, name)
        try:
            return self._index.item(name)
        except FileNotFoundError as error:
            raise ScanNotFound(f"{folder} holds no scan.") from error
        except OSError as error:
            raise OutputError(str(folder), reason(error), "Make its folder readable.") from error

    def folder_of(self, name: str) -> Path:
        """Where a scan lies, without looking at what it is. Raises ScanNotFound."""
        folder = inside(self.folder, name)
        try:
            if holds_scan(folder):
                return folder
        except OSError as error:
            raise OutputError(str(folder), reason(error), "Name a folder that can be read.") from error
        raise ScanNotFound(f"{folder} holds no scan.")

    def cloud(self, name: str, cloud: str) -> CloudItem:
        """A cloud of a scan, by its name within the scan; `clouds/` may be left out.

        Raises:
            ScanNotFound: there is no such scan.
            NotThere: it has no such cloud.
        """
        clouds = {each.name: each for each in self.scan(name).clouds}
        for wanted in (cloud, f"{CLOUDS_FOLDER}/{cloud}"):
            if wanted in clouds:
                return clouds[wanted]
        raise NotThere(f"The scan {name!r} has no cloud {cloud[:60]!r}.", "Ask for the scan: it lists them.")

    def erase_cloud(self, name: str, cloud: str) -> int:
        """Erase a cloud for good, with its picture and how it was made; how many bytes that gave back.

        Raises:
            ScanNotFound: there is no such scan.
            NotThere: it has no such cloud.
            LibraryError: the scan would be left with nothing.
            OutputError: it cannot be erased.
        """
        with work_folder(self.folder) as work, changing(self.folder):
            scan, found = self.scan(name), self.cloud(name, cloud)
            if not scan.pictures and len(scan.clouds) == 1:
                raise LibraryError(f"The scan {name!r} has nothing but this cloud.", "Delete the scan.")
            doomed = [scan.folder / found.name]
            if found.name.startswith(f"{CLOUDS_FOLDER}/"):
                # Elsewhere, the same name with another ending may belong to the recording.
                doomed += [doomed[0].with_suffix(ending) for ending in (".png", ".json")]
            there = [path for path in doomed if path.is_file()]
            freed = sum(path.stat().st_size for path in there)
            for path in there:
                path.rename(work / path.name)
            write_line(scan.folder, f"Erased the cloud {found.name}.")
            return freed

    def reserve(self, title: str) -> Path:
        """A new, empty folder for a scan that is about to begin, named after its title.

        Raises:
            LibraryError: the title cannot be used.
            OutputError: it cannot be made.
        """
        wanted = slug(checked_title(title))
        with changing(self.folder):
            folder = self.folder / free_name(self.folder, wanted)
            make_folder(folder)
        return folder

    def place(self, ready: Path, title: str) -> ScanItem:
        """Make a finished folder on the same disk a scan of the library.

        Raises:
            OutputError: it cannot be renamed.
        """
        settle()
        with changing(self.folder):
            name = free_name(self.folder, slug(title))
            _move(ready, self.folder / name)
        return self.scan(name)

    def rename(self, name: str, title: str) -> ScanItem:
        """Give it another title; its folder keeps its name.

        Raises:
            ScanNotFound: there is no such scan.
            LibraryError: the title cannot be used.
        """
        return self._describe(name, title=checked_title(title))

    def note(self, name: str, text: str) -> ScanItem:
        """Put another note in place of its note. Raises as `rename`."""
        return self._describe(name, note=checked_note(text))

    def delete(self, name: str) -> BinItem:
        """Put it into the bin.

        Raises:
            ScanNotFound: there is no such scan.
            ScanBusy: it is being taken.
            OutputError: it cannot be renamed.
        """
        with changing(self.folder):
            folder = self.scan(name).folder
            self.refuse_busy(name)
            make_folder(self.folder / BIN_FOLDER)
            key = free_name(self.folder / BIN_FOLDER, f"{datetime.now(UTC):{_DELETED}}.{name}")
            _move(folder, self.folder / BIN_FOLDER / key)
        return self._thrown_away(self._bin.item(key))

    def bin(self) -> tuple[BinItem, ...]:
        """What was thrown away, newest first. Raises OutputError where the folder cannot be read."""
        return tuple(self._thrown_away(item) for item in reversed(_read(self._bin)))

    def restore(self, key: str) -> ScanItem:
        """Bring a scan back from the bin; it gets another name where its own is taken.

        Args:
            key: its key in the bin, or the name it had: then the one that was thrown away last.

        Raises:
            ScanNotFound: the bin holds no such scan.
            OutputError: it cannot be renamed.
        """
        with changing(self.folder):
            thrown = self._in_bin(key)
            name = free_name(self.folder, thrown.name)
            _move(thrown.scan.folder, self.folder / name)
        return self.scan(name)

    def empty(self, keys: Sequence[str] | None = None, promised_bytes: int | None = None) -> int:
        """Erase what is in the bin, or these of it, for good; how many bytes that gave back.

        Args:
            keys: which; all by default.
            promised_bytes: what the person was told that this frees; nothing is erased where it is not so.

        Raises:
            ScanNotFound: the bin holds no such scan; nothing is erased.
            BinChanged: it would free something else than was promised.
            OutputError: something cannot be erased.
        """
        with work_folder(self.folder) as work:
            with changing(self.folder):
                doomed = self.bin() if keys is None else [self._in_bin(key) for key in keys]
                freed = sum(thrown.scan.size_bytes for thrown in doomed)
                if promised_bytes not in (None, freed):
                    raise BinChanged(f"This would free {freed} bytes, not {promised_bytes}.")
                # A scan that was erased in part must not be brought back, so it leaves the bin whole.
                for thrown in doomed:
                    _move(thrown.scan.folder, work / thrown.key)
            return freed

    def export(self, name: str) -> ZipStream:
        """Everything in the folder of a scan, as a zip file that is made while it is sent.

        Raises:
            ScanNotFound: there is no such scan.
            ScanBusy: it is being taken, so that there is no end of it.
            OutputError: it cannot be read.
        """
        folder = self.scan(name).folder
        self.refuse_busy(name)
        return ZipStream(folder, name)

    def space(self) -> Space:
        """Room on the disk. Raises OutputError where the disk does not tell."""
        in_bin = sum(thrown.scan.size_bytes for thrown in self.bin())
        used = sum(item.size_bytes for item in _read(self._index))
        return Space(free_bytes(self.folder), in_bin, used)

    def refuse_busy(self, name: str) -> None:
        """Raise ScanBusy while a scan is being taken."""
        if is_busy(self.folder / name):
            raise ScanBusy(f"The scan {name!r} is being taken.")

    def _describe(self, name: str, *, title: str | None = None, note: str | None = None) -> ScanItem:
        with changing(self.folder):
            item = self.scan(name)
            write_about(item.folder, created=item.created, title=title, note=note)
        return self.scan(name)

    def _in_bin(self, key: str) -> BinItem:
        for thrown in self.bin():
            if key in (thrown.key, thrown.name):
                return thrown
        raise ScanNotFound(
            f"There is no scan called {key[:60]!r} in the bin.", "See `turnscan library list --bin`."
        )

    def _thrown_away(self, item: ScanItem) -> BinItem:
        stamp, _, name = item.name.partition(".")
        try:
            deleted = datetime.strptime(stamp, _DELETED).replace(tzinfo=UTC)
        except ValueError:
            # Somebody else put it there.
            deleted, name = item.created, item.name
        titled = replace(item, title=name) if item.title == item.name else item
        return BinItem(item.name, name, deleted, titled)


def free_bytes(folder: Path) -> int:
    """What is left on the disk of a folder that may not be there yet. Raises OutputError."""
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.is_dir())
    try:
        return shutil.disk_usage(there).free
    except OSError as error:
        raise OutputError(str(there), reason(error)) from error


def _read(index: Index) -> tuple[ScanItem, ...]:
    try:
        return index.items()
    except OSError as error:
        raise OutputError(str(index.folder), reason(error), "Name a folder that can be read.") from error


def _move(folder: Path, to: Path) -> None:
    try:
        folder.rename(to)
    except OSError as error:
        raise OutputError(
            str(folder), reason(error), "Close the programs that use it, then try again."
        ) from error
