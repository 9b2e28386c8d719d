"""How soon the lasers of a real serial board are out when the server is interrupted, killed, or hangs."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from app.serving.addresses import listening
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort
from benchmarks.report import Row, at_most

_TIMES = 3
_GIVE_UP_S = 120.0
_ENDS = (
    ("after Ctrl-C", signal.SIGINT, 1.0),
    ("after kill -9", signal.SIGKILL, 1.0),
    ("after it hangs (SIGSTOP)", signal.SIGSTOP, 3.0),
)


def run() -> list[Row]:
    """The board is a program on a pseudo-terminal that no opening resets, so that it must be told."""
    note = f"worst of {_TIMES}, a Horus board without a camera"
    return [
        at_most(f"lasers out {words}", max(_dark_after_s(number) for _ in range(_TIMES)), "s", limit, note)
        for words, number, limit in _ENDS
    ]


def _dark_after_s(number: signal.Signals) -> float:
    """Seconds from the signal until no laser output is on."""
    plant = Plant(Wiring(3200.0))
    with tempfile.TemporaryDirectory(prefix="turnscan-farewell-") as place, listening("127.0.0.1", 0) as free:
        port = free.getsockname()[1]
        free.close()
        folder = Path(place)
        board = EmulatedPort(FIRMWARES.make("horus", plant=plant), folder / "board", resets_on_open=False)
        (folder / "bench.toml").write_text(
            f'[turntable]\ndriver = "horus"\nport = "{folder / "board"}"\n'
            f'[camera]\ndriver = "folder"\nfolder = "{folder / "nothing"}"\n'
            '[[lasers]]\nname = "left"\nchannel = 1\ncolour = "red"\n'
        )
        command = [sys.executable, "-m", "app", "serve", "--folder", place, "--port", str(port)]
        kept = {name: text for name, text in os.environ.items() if not name.startswith("TURNSCAN_")}
        with board, subprocess.Popen(command, env=kept, stderr=subprocess.DEVNULL) as server:
            try:
                _light(f"http://localhost:{port}/api/v1/bench")
                _wait(board, is_lit=True)
                began_s = time.monotonic()
                server.send_signal(number)
                _wait(board, is_lit=False)
                return time.monotonic() - began_s
            finally:
                server.kill()


def _light(bench: str) -> None:
    """Switch the laser on once the server has connected what it has; the missing camera comes last."""
    ends_s = time.monotonic() + _GIVE_UP_S
    while time.monotonic() < ends_s:
        try:
            with urllib.request.urlopen(bench) as answer:
                told = json.load(answer)
            if told["turntable"] and told["problems"]:
                break
        except OSError:
            pass
        time.sleep(0.05)
    body, kind = json.dumps({"on": True}).encode(), {"Content-Type": "application/json"}
    urllib.request.urlopen(urllib.request.Request(f"{bench}/lasers/left", body, kind)).close()


def _wait(board: EmulatedPort, *, is_lit: bool) -> None:
    ends_s = time.monotonic() + _GIVE_UP_S
    while bool(board.firmware.plant.at(board.clock.now_s()).outputs_on) != is_lit:
        if time.monotonic() > ends_s:
            raise TimeoutError(f"the lasers never went {'on' if is_lit else 'off'}")
        time.sleep(0.005)
