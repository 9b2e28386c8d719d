"""The 3D view: what a point costs a viewer, what the way through our own server costs, what a profile costs.

A viewer is a process of its own that reads as fast as it can and decodes nothing.
"""

import contextlib
import multiprocessing
import statistics
import struct
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from multiprocessing.queues import SimpleQueue
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event

import numpy as np
import uvicorn
import zstandard
from starlette.applications import Starlette
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.geometry.cloud import PointCloud
from app.scanning.profile import Profile
from app.viewer.cloud_view import CloudView
from app.viewer.page import viewer_page
from app.viewer.proxy import SOCKET_OPTIONS, view_routes
from benchmarks.report import Row, at_most

_PROFILE_POINTS = 700
# Two tenths of a second of a scan with 100 profiles a second.
_AT_ONCE = 20
_MILLIONS = 5
_REPLAYS = 7
_REPLAYED_POINTS = 6_000_000
_QUIET_S = 0.5


def run() -> list[Row]:
    return [*_growing(), *_replaying()]


def _growing() -> list[Row]:
    """A vase of 120 x 150 mm with five million points, seen by one viewer from the first point on."""
    rows, profiles = [], _MILLIONS * 1_000_000 // _PROFILE_POINTS
    with CloudView() as view, _served(view) as port, _Counter(port) as counter:
        view.begin(("laser",))
        view.settle()
        marks, nodes, used_s = [counter.received()], 0, 0.0
        add_s = 0.0
        for number in range(0, profiles, _AT_ONCE):
            batch = [_profile(n, profiles) for n in range(number, min(number + _AT_ONCE, profiles))]
            start, process_s = time.perf_counter(), time.process_time()
            for profile in batch:
                view.add(profile)
            add_s += time.perf_counter() - start
            view.settle()
            used_s += time.process_time() - process_s
            nodes = max(nodes, len(view._cloud._chunks.names))
            done = min(number + _AT_ONCE, profiles)
            if done * _PROFILE_POINTS >= len(marks) * 1_000_000 or done == profiles:
                marks.append(counter.settled())
        per_100k = [(after - before) / 10.0 / 1e6 for before, after in pairwise(marks)]
        before = counter.settled()
        shown = len(view._cloud)
        view.finish()
        view.settle()
        last = counter.settled() - before
    for million, megabytes in enumerate(per_100k, 1):
        rows.append(Row(f"sent to a viewer per 100 000 points, million {million}", megabytes, "MB"))
    first, last_two = statistics.mean(per_100k[:2]), statistics.mean(per_100k[-2:])
    rows += [
        at_most("the last two millions against the first two", last_two / first, "times", 1.25,
                "a million in which the display was thinned costs up to twice"),
        Row("sent at the end, the whole display exactly", last / 1e6, "MB", note=f"{shown:,} points shown"),
        Row("most nodes of the cloud at once", nodes, "nodes"),
        Row("caller's cost of a profile", add_s / profiles * 1e6, "µs"),
        Row("processor's cost of a profile, all threads", used_s / profiles * 1e3, "ms",
            note=f"{_PROFILE_POINTS} points, colouring, merging, sending and the proxy for one viewer"),
    ]  # fmt: skip
    return rows


def _replaying() -> list[Row]:
    """A large scene sent to who joins late: by viser itself and through our server, in turns."""
    usual, direct, proxied = [], [], []
    with CloudView(budget=2 * _REPLAYED_POINTS) as view, _served(view) as port:
        view.show_cloud(_anywhere(_REPLAYED_POINTS))
        view.settle(120.0)
        buffer = view._server._websock_server._broadcast_buffer
        ours, of_viser = buffer.max_window_size, type(buffer).max_window_size
        for _ in range(_REPLAYS):
            direct.append(_replay(view.port, "/"))
            proxied.append(_replay(port, "/view"))
            buffer.max_window_size = of_viser
            usual.append(_replay(view.port, "/"))
            buffer.max_window_size = ours
    through = statistics.median(proxied)
    what = "cost of the way through our server"
    return [
        Row("late joiner, direct to viser as it comes", statistics.median(usual), "MB/s",
            note=_spread(usual)),
        Row("late joiner, direct to viser as we set it", statistics.median(direct), "MB/s",
            note=_spread(direct)),
        Row("late joiner, through our server", through, "MB/s", note=_spread(proxied)),
        at_most(f"{what}, against viser as it comes",
                100.0 * (1.0 - through / statistics.median(usual)), "%", 15.0),
        at_most(f"{what}, against viser as we set it",
                100.0 * (1.0 - through / statistics.median(direct)), "%", 15.0,
                "smaller frames help the direct way still more"),
    ]  # fmt: skip


def _spread(values: list[float]) -> str:
    return f"{min(values):.0f} to {max(values):.0f} in {len(values)} runs"


def _profile(number: int, of: int) -> Profile:
    angle = 2.0 * np.pi * number / of
    height = np.linspace(0.0, 150.0, _PROFILE_POINTS)
    radius = 55.0 + 5.0 * np.sin(height / 12.0)
    outward = np.array([np.cos(angle), np.sin(angle), 0.0])
    points = radius[:, None] * outward + height[:, None] * np.array([0.0, 0.0, 1.0])
    normals = np.broadcast_to(outward, points.shape)
    return Profile(number, "laser", angle, _cloud(points, normals))


def _anywhere(count: int) -> PointCloud:
    points = np.random.default_rng(1).uniform(0.0, 200.0, (count, 3))
    return _cloud(points, np.zeros_like(points))


def _cloud(points: np.ndarray, normals: np.ndarray) -> PointCloud:
    count = len(points)
    return PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((count, 3), 160, np.uint8),
        np.zeros(count, np.float32), np.zeros(count, np.uint8), np.zeros(count, np.float32),
        np.ones(count, np.float32), ("laser",),
    )  # fmt: skip


@contextlib.contextmanager
def _served(view: CloudView) -> Iterator[int]:
    app = Starlette(routes=view_routes(view, lambda _: True))
    config = uvicorn.Config(app, port=0, log_level="error", lifespan="off", **SOCKET_OPTIONS)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, name="web server")
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield server.servers[0].sockets[0].getsockname()[1]
    server.should_exit = True
    thread.join()


class _Counter:
    """A viewer in a process of its own; tells how many bytes have come."""

    def __init__(self, port: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._received: Synchronized[int] = context.Value("q", 0)
        self._end = context.Event()
        self._process = context.Process(
            target=_count, args=(port, "/view", viewer_page().dialect, self._received, self._end)
        )

    def __enter__(self) -> "_Counter":
        self._process.start()
        self.settled()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._process.join()

    def received(self) -> int:
        return int(self._received.value)

    def settled(self) -> int:
        """The count when nothing comes any more."""
        while True:
            before = self.received()
            time.sleep(_QUIET_S)
            if before and self.received() == before:
                return before


def _count(port: int, path: str, dialect: str, received: "Synchronized[int]", end: "Event") -> None:
    with _socket(port, path, dialect) as socket:
        while not end.is_set():
            with contextlib.suppress(TimeoutError):
                received.value += len(socket.recv(timeout=0.1))


def _replay(port: int, path: str) -> float:
    """MB/s from the first byte asked for to the last that comes."""
    context = multiprocessing.get_context("spawn")
    answer: SimpleQueue[float] = context.SimpleQueue()
    process = context.Process(target=_time_replay, args=(port, path, viewer_page().dialect, answer))
    process.start()
    rate: float = answer.get()
    process.join()
    return rate


def _time_replay(port: int, path: str, dialect: str, answer: "SimpleQueue[float]") -> None:
    received, start_s = 0, time.perf_counter()
    with _socket(port, path, dialect) as socket:
        for data in socket:
            assert isinstance(data, bytes)
            received += len(data)
            if _is_last_of_replay(data):
                break
        answer.put(received / 1e6 / (time.perf_counter() - start_s))


def _is_last_of_replay(data: bytes) -> bool:
    """Whether the messages of a frame, which stand before its arrays, tell that all has been sent again."""
    length, packed = struct.unpack_from("<QQ", data)
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=length)
    return b"ReplayDoneMessage" in inner


def _socket(port: int, path: str, dialect: str) -> ClientConnection:
    return connect(
        f"ws://127.0.0.1:{port}{path}", subprotocols=[Subprotocol(dialect)], compression=None, max_size=None,
        proxy=None, ping_interval=None,
    )  # fmt: skip
