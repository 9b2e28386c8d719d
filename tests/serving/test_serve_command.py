"""`turnscan serve` as a program: it starts whatever is missing, tells systemd, and ends at once when told."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from app.devices.bench_file import BenchDescription, simulated_description
from app.serving.addresses import listening

_TURNSCAN = (sys.executable, "-m", "app", "serve")
_DEADLINE_S = 120.0


class Served:
    """A server in a process of its own."""

    def __init__(self, folder: Path, *options: str, **environment: str) -> None:
        with listening("127.0.0.1", 0) as free:
            self.port = free.getsockname()[1]
        kept = {name: text for name, text in os.environ.items() if not name.startswith("TURNSCAN_")}
        root = Path(__file__).resolve().parents[2]
        self.words = folder / "words.txt"
        with self.words.open("w") as words:
            self.process = subprocess.Popen(
                [*_TURNSCAN, "--port", str(self.port), "--folder", str(folder / "kept"), *options],
                cwd=folder, env=kept | {"PYTHONPATH": str(root)} | environment, stdout=words, stderr=words,
            )  # fmt: skip

    def ask(self, path: str, body: object = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"http://localhost:{self.port}{path}", data, {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(request, timeout=_DEADLINE_S) as answer:
            return json.loads(answer.read())

    def answers(self) -> bool:
        assert self.process.poll() is None, self.words.read_text()
        try:
            self.ask("/api/v1/bench")
        except OSError:
            return False
        return True

    def wait(self) -> int:
        return self.process.wait(_DEADLINE_S)


@contextmanager
def served(folder: Path, *options: str, **environment: str) -> Iterator[Served]:
    server = Served(folder, *options, **environment)
    try:
        _until(server.answers)
        yield server
    finally:
        if server.process.poll() is None:
            server.process.kill()
        server.wait()


@contextmanager
def streaming(server: Served, path: str) -> Iterator[None]:
    """A reader that has begun and reads no further."""
    with socket.create_connection(("127.0.0.1", server.port), _DEADLINE_S) as reader:
        reader.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost:{server.port}\r\n\r\n".encode())
        assert reader.recv(400).startswith(b"HTTP/1.1 200")
        yield


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no place that not even root can write to")
def test_without_a_bench_and_where_nothing_can_be_kept_it_serves_and_says_so(tmp_path: Path) -> None:
    with served(tmp_path, "--folder", "/proc/no-folder") as server:
        _until(lambda: len(server.ask("/api/v1/bench")["problems"]) >= 3)
        problems = " ".join(server.ask("/api/v1/bench")["problems"])
        assert "nothing can be kept" in problems
        assert "bench.toml: is not here" in problems
        with pytest.raises(urllib.error.HTTPError) as refused:
            server.ask("/api/v1/jobs/scan", {})
        refused.value.close()
        assert refused.value.code == 422
        server.process.send_signal(signal.SIGTERM)
        assert server.wait() == 0
    text = server.words.read_text()
    assert f"http://localhost:{server.port}" in text
    assert "There will be no log file" in text
    assert "Traceback" not in text


def test_it_tells_systemd_and_ends_with_everything_open(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(_small_bench(simulated_description(object="sphere", width=320, height=240)))
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.settimeout(_DEADLINE_S)
        with served(tmp_path, NOTIFY_SOCKET=address, WATCHDOG_USEC="1500000") as server:
            assert manager.recv(200).startswith(b"READY=1")
            assert manager.recv(200) == b"WATCHDOG=1"
            _until(lambda: server.ask("/api/v1/bench")["camera"]["connected"])
            server.ask("/api/v1/bench/lasers/left", {"on": True})
            with streaming(server, "/api/v1/live/raw.mjpeg"), streaming(server, "/api/v1/events/stream"):
                server.process.send_signal(signal.SIGINT)
                server.process.send_signal(signal.SIGINT)
                assert server.wait() == 0
        told = b""
        while told != b"STOPPING=1":
            told = manager.recv(200)
    assert "Traceback" not in server.words.read_text()
    assert "does not end by itself" not in server.words.read_text()


def _small_bench(description: BenchDescription) -> str:
    lasers = "\n".join(
        f'[[lasers]]\nname = "{each.name}"\nchannel = {each.channel}\ncolour = "red"'
        for each in description.lasers
    )
    options = "\n".join(
        f"{name} = {json.dumps(value)}" for name, value in (description.simulation or {}).items()
    )
    devices = '[turntable]\ndriver = "simulated"\n[camera]\ndriver = "simulated"'
    return f"{devices}\n{lasers}\n[simulation]\n{options}\n"


def _until(is_so: Callable[[], object]) -> None:
    ends = time.monotonic() + _DEADLINE_S
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.05)
