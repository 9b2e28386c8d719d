"""A whole server on a small simulated bench, on a port of its own."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn

from app.api.services import Services
from app.api.versioned import API
from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.errors import DeviceError
from app.main import create_app
from app.settings import Settings
from app.viewer.proxy import SOCKET_OPTIONS

SOON_S = 120.0


@dataclass(frozen=True)
class Running:
    """A server: where it is, and what it is made of."""

    port: int
    services: Services

    @property
    def http(self) -> str:
        return f"http://localhost:{self.port}{API}"

    @property
    def sockets(self) -> str:
        return f"ws://localhost:{self.port}{API}"


@contextlib.contextmanager
def running_server(folder: Path, **simulation: Any) -> Iterator[Running]:
    """With small pictures, and with little room between server and client for what is not read."""
    description = simulated_description("horus", **{"width": 320, "height": 240, "rate": 20.0} | simulation)
    application = create_app(Settings(folder, "simulated"), description)
    listening = socket.create_server(("127.0.0.1", 0), backlog=256)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    config = uvicorn.Config(application, log_level="critical", timeout_graceful_shutdown=5, **SOCKET_OPTIONS)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, args=([listening],), name="web server")
    thread.start()
    services: Services = application.state.services
    try:
        wait_until(lambda: server.started)
        wait_until_connected(services.bench)
        yield Running(listening.getsockname()[1], services)
    finally:
        server.should_exit = True
        thread.join()
        listening.close()


def wait_until_connected(bench: Bench) -> None:
    """Until camera and board are there; one that was not heard in time on a busy machine is asked again."""

    def is_there() -> bool:
        now = bench.snapshot()
        if now.problems:
            with contextlib.suppress(DeviceError):
                bench.connect()
        return bool(now.turntable) and now.camera.frames > 0

    wait_until(is_there)


def wait_until(is_so: Callable[[], bool]) -> None:
    """Poll, and fail when it does not come to be."""
    ends_s = time.monotonic() + SOON_S
    while not is_so():
        assert time.monotonic() < ends_s, "it never came to be"
        time.sleep(0.01)
