"""A server with a simulated bench, in a process of its own."""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.bench_text import simulated_bench
from benchmarks.journeys import wait_until_ready

_FAREWELL_S = 30.0


@contextmanager
def served(folder: Path, **simulation: str | float) -> Iterator[str]:
    """The address of `turnscan serve` in a process of its own.

    Args:
        folder: empty; for all that it keeps.
        simulation: further keys of the simulated bench, see `WorldPlan`; without others, of a ball.
    """
    wanted: dict[str, str | float] = {"dialect": "horus", "object": "sphere", **simulation}
    bench = folder / "bench.toml"
    bench.write_text(simulated_bench(wanted, name="simulated bench", turntable=""))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    command = [sys.executable, "-m", "app", "serve", "--bench", str(bench), "--folder", str(folder)]
    with (folder / "server.txt").open("wb") as told:
        process = subprocess.Popen([*command, "--port", str(port)], stdout=told, stderr=subprocess.STDOUT)
        try:
            address = f"http://localhost:{port}"
            wait_until_ready(address)
            yield address
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(_FAREWELL_S)
