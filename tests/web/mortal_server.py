"""`turnscan serve` in a process of its own, at an address that outlives it."""

import os
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

from app.api.versioned import API
from app.serving.addresses import listening
from benchmarks.bench_text import simulated_bench

_ROOT = Path(__file__).resolve().parents[2]
# Its simulated board keeps no other time than those in the tests' own processes.
_PROGRAM = "import steady_time; from app.cli.main import main; main()"
_PATIENCE_S = 120.0


class MortalServer:
    """Serves a folder, again and again.

    Args:
        folder: for its bench file, and all that it keeps.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        with listening("127.0.0.1", 0) as free:
            self._port = free.getsockname()[1]

    @property
    def address(self) -> str:
        return f"http://localhost:{self._port}"

    def start(self, **simulation: str | float) -> None:
        """Begin, and wait until it answers.

        Args:
            simulation: keys of the simulated bench, see `WorldPlan`.
        """
        bench = self._folder / "bench.toml"
        bench.write_text(simulated_bench(simulation))
        kept = {name: text for name, text in os.environ.items() if not name.startswith("TURNSCAN_")}
        kept["PYTHONPATH"] = os.pathsep.join((str(_ROOT), str(_ROOT / "tests")))
        command = [
            sys.executable,
            "-c",
            _PROGRAM,
            "serve",
            "--bench",
            str(bench),
            "--folder",
            str(self._folder),
        ]
        with (self._folder / "server.txt").open("ab") as told:
            self._process = subprocess.Popen(
                [*command, "--port", str(self._port)], env=kept, stdout=told, stderr=told
            )
        ends_s = time.monotonic() + _PATIENCE_S
        while not self._answers():
            assert self._process.poll() is None, (self._folder / "server.txt").read_text()
            assert time.monotonic() < ends_s, "the server is too slow"
            time.sleep(0.05)

    def kill(self) -> None:
        """As the power would."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _answers(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.address}{API}/bench", timeout=_PATIENCE_S):
                return True
        except (urllib.error.URLError, OSError):
            return False
