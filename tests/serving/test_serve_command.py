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

import cv2
import numpy as np
import pytest
import viser
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.serving.addresses import listening
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

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

    def headers(self, sent: dict[str, str]) -> dict[str, str]:
        """Those of an answer, in small letters."""
        request = urllib.request.Request(f"http://localhost:{self.port}/api/v1/bench", headers=sent)
        with urllib.request.urlopen(request, timeout=_DEADLINE_S) as answer:
            return {name.lower(): text for name, text in answer.headers.items()}

    def websocket(self, path: str, *dialects: str) -> ClientConnection:
        """A WebSocket that reads nothing by itself."""
        spoken = [Subprotocol(each) for each in dialects] or None
        address = f"ws://localhost:{self.port}{path}"
        return connect(address, subprotocols=spoken, open_timeout=_DEADLINE_S, proxy=None)

    @contextmanager
    def uploading(self, length: bytes) -> Iterator[socket.socket]:
        """A connection on which an upload is announced."""
        with socket.create_connection(("127.0.0.1", self.port), _DEADLINE_S) as sender:
            head = f"POST /api/v1/scans/upload?file=a.ply HTTP/1.1\r\nHost: localhost:{self.port}\r\n"
            sender.sendall(head.encode() + length)
            yield sender

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
        assert "strict-transport-security" not in server.headers({"X-Forwarded-Proto": "https"})
        assert server.ask("/api/v1/bench/stop", {})["lasers"] == []
        with urllib.request.urlopen(f"http://localhost:{server.port}/metrics", timeout=_DEADLINE_S) as answer:
            assert b"turnscan_camera" in answer.read()
        server.process.send_signal(signal.SIGTERM)
        assert server.wait() == 0
    text = server.words.read_text()
    assert f"http://localhost:{server.port}" in text
    assert "There will be no log file" in text
    assert "Traceback" not in text


def test_it_tells_systemd_and_ends_with_everything_open(tmp_path: Path) -> None:
    address, kept = str(tmp_path / "notify"), tmp_path / "kept"
    pictures = tmp_path / "pictures"
    for folder in (kept, pictures):
        folder.mkdir()
    cv2.imwrite(str(pictures / "1.jpg"), np.zeros((240, 320, 3), np.uint8))
    plant = Plant(Wiring(3200.0))
    with (
        EmulatedPort(FIRMWARES.make("horus", plant=plant), tmp_path / "board") as board,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
    ):
        # Where the page keeps the bench that is chosen in it.
        (kept / "bench.toml").write_text(_bench_at(board.link, pictures))
        manager.bind(address)
        manager.settimeout(_DEADLINE_S)
        options = ("--upload-bytes", "2000000", "--proxy", "127.0.0.1")
        with served(tmp_path, *options, NOTIFY_SOCKET=address, WATCHDOG_USEC="1500000") as server:
            assert manager.recv(200).startswith(b"READY=1")
            assert manager.recv(200) == b"WATCHDOG=1"
            assert "strict-transport-security" in server.headers({"X-Forwarded-Proto": "https"})
            _until(lambda: server.ask("/api/v1/bench")["camera"]["connected"])
            _until(lambda: server.ask("/api/v1/bench")["turntable"])
            _send_too_much(server)
            _break_an_upload_off(server, kept / "scans")
            server.ask("/api/v1/bench/lasers/left", {"on": True})
            _until(lambda: plant.at(board.clock.now_s()).outputs_on)
            with (
                streaming(server, "/api/v1/live/raw.mjpeg"), streaming(server, "/api/v1/events/stream"),
                server.websocket("/api/v1/live/raw"), server.websocket("/api/v1/events"),
                server.websocket("/view/", f"viser-v{viser.__version__}"),
            ):  # fmt: skip
                server.process.send_signal(signal.SIGINT)
                server.process.send_signal(signal.SIGTERM)
                assert server.wait() == 0
            _until(lambda: not plant.at(board.clock.now_s()).outputs_on)
        told = b""
        while told != b"STOPPING=1":
            told = manager.recv(200)
    assert "Traceback" not in server.words.read_text()
    assert "does not end by itself" not in server.words.read_text()


def test_it_ends_in_good_order_while_its_first_start_still_compiles(tmp_path: Path) -> None:
    with served(tmp_path, "--bench", "simulated", NUMBA_CACHE_DIR=str(tmp_path / "compiled")) as server:
        _until(lambda: server.ask("/api/v1/bench")["turntable"])
        assert not server.ask("/api/v1/bench")["camera"]["connected"]
        server.process.send_signal(signal.SIGTERM)
        assert server.wait() == 0
    assert "does not end by itself" not in server.words.read_text()


def _send_too_much(server: Served) -> None:
    """Nobody will read it, so the connection is of no further use."""
    with server.uploading(b"Content-Length: 3000000\r\n\r\n") as sender:
        answer = b""
        while piece := sender.recv(4096):
            answer += piece
    assert answer.startswith(b"HTTP/1.1 413")
    assert b"\r\nconnection: close\r\n" in answer.lower()


def _break_an_upload_off(server: Served, scans: Path) -> None:
    with server.uploading(b"Content-Length: 1500000\r\n\r\n") as sender:
        sender.sendall(b"ply\n" + bytes(1_200_000))
        _until(lambda: list((scans / ".work").glob("*/arrived")))
    _until(lambda: not list((scans / ".work").glob("*")))
    assert [path.name for path in scans.iterdir() if not path.name.startswith(".")] == []


def _bench_at(port: Path, pictures: Path) -> str:
    devices = (
        f'[turntable]\ndriver = "horus"\nport = "{port}"\n[camera]\ndriver = "folder"\nfolder = "{pictures}"'
    )
    return f'{devices}\n[[lasers]]\nname = "left"\nchannel = 1\ncolour = "red"\n'


def _until(is_so: Callable[[], object]) -> None:
    ends = time.monotonic() + _DEADLINE_S
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.05)
