"""Which bench the server has, and taking another one while it runs."""

import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, parse_bench, write_bench_file
from app.errors import DeviceError, OutputError
from app.files import reason, write_whole
from app.library.names import free_name
from app.live.pictures import LivePictures


class BenchChoice:
    """The bench in use, by what names it.

    Args:
        spec: a bench file, or `simulated`.
        file: where a bench that is chosen here is written; one that is there already is kept as another.
        bench, live: which go on with the new devices.
        on_change: told when there are other devices, connected as far as they can be.
    """

    def __init__(
        self, spec: str, file: Path, bench: Bench, live: LivePictures, on_change: Callable[[], None]
    ) -> None:
        self.spec = spec
        self._file, self._bench, self._live, self._on_change = file, bench, live, on_change
        self._lock = threading.Lock()

    def choose(self, text: str) -> str:
        """Use the bench of this file's text from now on; a sentence for each device that cannot be connected.

        Raises:
            BenchBusy: a job holds the bench.
            BenchFileError, OptionError: it is no bench.
            OutputError: it cannot be kept.
        """
        description = parse_bench(text.encode(), self._file.name)
        with self._lock:
            self._exchange(description)
            self._keep(text)
            self.spec = str(self._file)
        return self._connected()

    def choose_simulated(self, description: BenchDescription) -> str:
        """The same with the bench that needs no file."""
        with self._lock:
            self._exchange(description)
            self.spec = "simulated"
        return self._connected()

    def _exchange(self, description: BenchDescription) -> None:
        self._bench.exchange(description)
        self._live.look_through(self._bench)

    def _keep(self, text: str) -> None:
        if self._file.exists():
            stem = f"{self._file.stem}-until-{datetime.now(UTC):%Y%m%dT%H%M%S}"
            former = self._file.with_name(free_name(self._file.parent, stem, ".toml"))
            try:
                data = self._file.read_bytes()
            except OSError as error:
                raise OutputError(str(self._file), reason(error)) from error
            # The file itself stays until there is another in its place.
            write_whole(former, data)
        write_bench_file(self._file, text)

    def _connected(self) -> str:
        try:
            self._bench.connect()
        except DeviceError as error:
            return f"{error.message}. {error.hint}"
        finally:
            self._on_change()
        return ""
