"""A scan that comes in over the network: kept beside the library until all of it is there and checked."""

from contextlib import ExitStack
from typing import BinaryIO

from app.errors import OutputError, TooLarge
from app.files import reason
from app.library.item import ScanItem
from app.library.library import Library
from app.library.limits import Limits, check_room, in_words
from app.library.take_in import take_in
from app.library.work import work_folder

_LOOK_EVERY = 64 << 20
_EXPANSION = 4


class Arrival:
    """A file that grows piece by piece; when the block ends nothing of it is left but the scan.

    Args:
        library: where the scan goes, and how much it takes.
        promised_bytes: how much will come, where that was said.

    Raises:
        TooLarge: more is promised, or comes.
        OutputError: there is no room, or the disk fails.
    """

    def __init__(self, library: Library, promised_bytes: int | None = None) -> None:
        self.library, self.limit_bytes = library, library.upload_bytes
        self.promised_bytes = promised_bytes or 0
        self.size_bytes = 0
        self._looked_at = 0
        self._file: BinaryIO | None = None
        self._open = ExitStack()

    def __enter__(self) -> "Arrival":
        self._check_size(self.promised_bytes)
        check_room(self.library.folder, self.promised_bytes)
        with ExitStack() as opening:
            self._path = opening.enter_context(work_folder(self.library.folder)) / "arrived"
            self._file = opening.enter_context(self._path.open("xb"))
            self._open = opening.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def write(self, data: bytes) -> None:
        """The next piece."""
        assert self._file is not None
        self._check_size(self.size_bytes + len(data))
        if self.size_bytes >= self._looked_at:
            self._looked_at += _LOOK_EVERY
            check_room(self.library.folder, max(_LOOK_EVERY, self.promised_bytes - self.size_bytes))
        try:
            self._file.write(data)
        except OSError as error:
            raise OutputError(str(self.library.folder), reason(error)) from error
        self.size_bytes += len(data)

    def take_in(self, title: str = "", called: str = "upload") -> ScanItem:
        """Make it a scan, now that all of it is here. Raises as `take_in`."""
        assert self._file is not None
        try:
            self._file.close()
        except OSError as error:
            raise OutputError(str(self.library.folder), reason(error)) from error
        limits = Limits(total_bytes=_EXPANSION * self.limit_bytes, cloud_bytes=self.limit_bytes)
        return take_in(self.library, self._path, title, name=called, limits=limits)

    def _check_size(self, size_bytes: int) -> None:
        if size_bytes > self.limit_bytes:
            raise TooLarge(f"The upload is larger than {in_words(self.limit_bytes)}.")
