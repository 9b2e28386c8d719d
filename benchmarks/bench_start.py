"""How long `turnscan serve` takes from its command to its first answer, and until the bench is connected."""

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request

from app.serving.addresses import listening
from benchmarks.report import Row, at_most

_TIMES = 5
_GIVE_UP_S = 120.0


def run() -> list[Row]:
    with tempfile.TemporaryDirectory(prefix="turnscan-start-") as folder:
        # The first one compiles, or reads what was compiled into the machine's memory.
        _started(folder)
        times = [_started(folder) for _ in range(_TIMES)]
    first, connected, ended = (statistics.median(each) for each in zip(*times, strict=True))
    note = f"median of {_TIMES}, simulated bench"
    return [
        at_most("from the command to the first answer", first, "s", 3.0, note),
        Row("until camera and board are connected", connected, "s", note=note),
        Row("from SIGTERM to the end", ended, "s", note=note),
    ]


def _started(folder: str) -> tuple[float, float, float]:
    """Seconds to the first answer, to a connected bench, and from the signal to the end."""
    with listening("127.0.0.1", 0) as free:
        port = free.getsockname()[1]
    kept = {name: text for name, text in os.environ.items() if not name.startswith("TURNSCAN_")}
    command = [sys.executable, "-m", "app", "serve", "--bench", "simulated", "--folder", folder]
    began_s = time.monotonic()
    server = subprocess.Popen([*command, "--port", str(port)], env=kept, stderr=subprocess.DEVNULL)
    try:
        first_s = connected_s = 0.0
        while not connected_s and time.monotonic() < began_s + _GIVE_UP_S:
            try:
                with urllib.request.urlopen(f"http://localhost:{port}/api/v1/bench") as answer:
                    bench = json.load(answer)
            except OSError:
                time.sleep(0.01)
                continue
            now_s = time.monotonic() - began_s
            first_s = first_s or now_s
            if bench["camera"]["connected"] and bench["turntable"]:
                connected_s = now_s
            time.sleep(0.01)
    finally:
        told_s = time.monotonic()
        server.send_signal(signal.SIGTERM)
        server.wait(_GIVE_UP_S)
    return first_s, connected_s, time.monotonic() - told_s
