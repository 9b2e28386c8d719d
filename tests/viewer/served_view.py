"""A 3D view behind a real server, and a viewer that speaks viser's protocol without a browser."""

import contextlib
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np
import uvicorn
import zstandard
from numpy.typing import NDArray
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.routing import BaseRoute
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.geometry.cloud import PointCloud
from app.scanning.profile import Profile
from app.viewer.cloud_view import CloudView
from app.viewer.page import viewer_page
from app.viewer.proxy import SOCKET_OPTIONS, view_routes

DEADLINE_S = 60.0


def wait_until(is_so: Callable[[], bool], timeout_s: float = DEADLINE_S) -> None:
    """Return as soon as something is so; fail if it never is."""
    end_s = time.monotonic() + timeout_s
    while not is_so():
        if time.monotonic() > end_s:
            raise AssertionError(f"it was not so within {timeout_s:g} s")
        time.sleep(0.01)


def everybody(_: Request | WebSocket) -> bool:
    return True


@contextlib.contextmanager
def served(
    view: CloudView,
    may_enter: Callable[[Request | WebSocket], bool] = everybody,
    more: Sequence[BaseRoute] = (),
) -> Iterator[int]:
    """The view's routes, and more, under uvicorn on a free port, which is returned."""
    app = Starlette(routes=[*view_routes(view, may_enter), *more])
    config = uvicorn.Config(
        app, port=0, log_level="error", lifespan="off", timeout_graceful_shutdown=1, **SOCKET_OPTIONS
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, name="web server")
    thread.start()
    try:
        wait_until(lambda: server.started)
        yield server.servers[0].sockets[0].getsockname()[1]
    finally:
        server.should_exit = True
        thread.join()


@dataclass
class Node:
    """A node of the scene as a viewer knows it.

    Attributes:
        kind: the message that made it.
        props: of that message, later changes applied; arrays as raw bytes.
        wxyz, position: its place below its parent.
    """

    kind: str
    props: dict[str, Any]
    wxyz: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    position: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass
class Viewer:
    """Connects, reads in a thread of its own, and keeps the scene.

    Attributes:
        nodes: by name.
        received: bytes so far.
        has_replayed: whether all that was there before has come.
        others: messages that are not about nodes, by kind, the newest of each.
    """

    socket: ClientConnection
    nodes: dict[str, Node] = field(default_factory=dict)
    received: int = 0
    has_replayed: bool = False
    others: dict[str, dict[str, Any]] = field(default_factory=dict)
    most_nodes: int = 0

    def __post_init__(self) -> None:
        self._thread = threading.Thread(target=self._read, name="viewer")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.socket.close()
        self._thread.join()

    def send(self, kind: str, **fields: Any) -> None:
        self.socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def look(
        self,
        wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        position: Sequence[float] = (0.0, -400.0, 200.0),
    ) -> None:
        """Say where the viewer stands, after which viser counts him."""
        self.send(
            "ViewerCameraMessage", wxyz=wxyz, position=position, fov=0.7, near=1.0, far=6000.0,
            image_height=600, image_width=800, look_at=(0.0, 0.0, 40.0), up_direction=(0.0, 0.0, 1.0),
        )  # fmt: skip

    def clouds(self) -> dict[str, NDArray[np.float64]]:
        """The points of every node of the scan, in table coordinates."""
        found = {}
        for name, node in tuple(self.nodes.items()):
            if node.kind == "PointCloudMessage":
                points = node.props["points"]
                found[name] = points.astype(np.float64).reshape(-1, 3) + np.array(node.position)
        return found

    def count(self) -> int:
        """How many points there are but those that are marked."""
        nodes = [node for name, node in tuple(self.nodes.items()) if not name.endswith("/newest")]
        return sum(node.props["points"].size // 3 for node in nodes if node.kind == "PointCloudMessage")

    def points(self) -> NDArray[np.float64]:
        """All points but those that are marked."""
        parts = [points for name, points in self.clouds().items() if not name.endswith("/newest")]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for data in self.socket:
                assert isinstance(data, bytes)
                self.received += len(data)
                for message in decoded(data):
                    self._apply(message)
                self.most_nodes = max(self.most_nodes, len(self.nodes))

    def _apply(self, message: dict[str, Any]) -> None:
        kind, name = message.pop("type"), message.get("name")
        if kind == "ReplayDoneMessage":
            self.has_replayed = True
        elif kind == "RemoveSceneNodeMessage":
            for gone in [known for known in self.nodes if known == name or known.startswith(f"{name}/")]:
                del self.nodes[gone]
        elif kind == "SetOrientationMessage" and name in self.nodes:
            self.nodes[name].wxyz = tuple(message["wxyz"])
        elif kind == "SetPositionMessage" and name in self.nodes:
            self.nodes[name].position = tuple(message["position"])
        elif kind == "SceneNodeUpdateMessage" and name in self.nodes:
            self.nodes[name].props.update(message["updates"])
        elif isinstance(name, str) and "props" in message:
            self.nodes[name] = Node(kind, message["props"])
        else:
            self.others[kind] = message


def decoded(data: bytes) -> list[dict[str, Any]]:
    """The messages of one frame, arrays in their places."""
    length, packed = struct.unpack_from("<QQ", data)
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=length)
    frame = msgspec.msgpack.decode(inner)
    arrays, offset = [], 16 + packed
    for size in frame["binaryBufferLengths"]:
        offset += -offset % 8
        arrays.append(data[offset : offset + size])
        offset += size
    messages: list[dict[str, Any]] = [_filled(message, arrays) for message in frame["messages"]]
    return messages


def _filled(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, dict):
        if "__binary_index" in value:
            return np.frombuffer(arrays[value["__binary_index"]], np.dtype(value["dtype"]))
        return {key: _filled(inner, arrays) for key, inner in value.items()}
    if isinstance(value, list):
        return [_filled(inner, arrays) for inner in value]
    return value


def watch(port: int, path: str = "/view", **options: Any) -> Viewer:
    """A viewer behind the proxy; `with` lets him read."""
    return Viewer(socket_to(port, path, **options))


def socket_to(port: int, path: str = "/view", dialect: str | None = None, **options: Any) -> ClientConnection:
    """A bare socket that speaks viser's dialect."""
    spoken = Subprotocol(dialect or viewer_page().dialect)
    return connect(
        f"ws://127.0.0.1:{port}{path}", subprotocols=[spoken], compression=None, max_size=None, proxy=None,
        ping_interval=None, **options,
    )  # fmt: skip


def profile(number: int, laser: str = "left", points: int = 700, of: int = 360) -> Profile:
    """One profile of a vase of about 60 mm: lit at an angle, seen from outside."""
    angle = 2.0 * np.pi * number / of
    height = np.linspace(0.0, 80.0, points)
    radius = 25.0 + 6.0 * np.sin(height / 12.0)
    outward = np.array([np.cos(-angle), np.sin(-angle), 0.0])
    xyz = radius[:, None] * outward + height[:, None] * np.array([0.0, 0.0, 1.0])
    cloud = PointCloud(
        xyz.astype(np.float32),
        np.broadcast_to(outward, (points, 3)).astype(np.float32),
        np.tile(np.array([200, 150, 90], np.uint8), (points, 1)),
        np.full(points, 0.05, np.float32),
        np.full(points, 0 if laser == "left" else 1, np.uint8),
        np.full(points, np.degrees(angle), np.float32),
        np.linspace(0.2, 1.0, points, dtype=np.float32),
        ("left", "right"),
    )
    return Profile(number, laser, angle, cloud)
