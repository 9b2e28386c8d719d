"""Live pictures over the network: many clients, stalled ones, and what their messages say."""

import asyncio
import socket
import struct
import threading
from collections.abc import Iterator

import httpx2
import pytest
from running_server import SOON_S, Running, running_server, wait_until
from websockets.asyncio.client import ClientConnection, connect

from app.api import patience
from app.api.versioned import API
from app.live.picture import unpack
from app.live.settings import Kind
from app.recording.picture import decode

_KINDS = ("raw", "mask", "overlay", "stripe", "mask?packed=true")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_server(tmp_path_factory.mktemp("server")) as server:
        yield server


def test_a_hundred_clients_some_of_whom_never_read_leave_the_server_at_ease(server: Running) -> None:
    threads = threading.active_count()
    most = asyncio.run(_hundred(server, threads))
    # Those of the live pictures, and of the pool that other requests use: none for each viewer.
    assert most - threads < 15
    wait_until(lambda: not server.services.live.state.is_running)
    assert server.services.runner.bus.listeners == 0


async def _hundred(server: Running, threads: int) -> int:
    live, events, stalled = [], [], []
    most = threads
    try:
        for number in range(50):
            address = f"{server.sockets}/live/{_KINDS[number % len(_KINDS)]}"
            live.append(await connect(address, max_size=None, proxy=None))
            events.append(await connect(f"{server.sockets}/events", proxy=None))
        for kind in ("raw", "overlay", "stripe"):
            lazy = await connect(f"{server.sockets}/live/{kind}", max_queue=1, proxy=None)
            for _ in range(5):
                await lazy.send("next")
            stalled.append(lazy)

        async def look(viewer: ClientConnection) -> list[int]:
            frames = []
            for _ in range(3):
                await viewer.send("next")
                frames.append(unpack(bytes(await viewer.recv(decode=False))).facts["frame"])
            return frames

        async with asyncio.timeout(SOON_S), httpx2.AsyncClient(trust_env=False) as client:
            looking = [asyncio.create_task(look(viewer)) for viewer in live]
            for _ in range(3):
                assert (await client.get(f"{server.http}/bench")).status_code == 200
                most = max(most, threading.active_count())
            for frames in await asyncio.gather(*looking):
                assert frames == sorted(set(frames)), "no picture comes twice, and none is older"
            for listener in events:
                assert '"type":"state"' in str(await listener.recv())
    finally:
        await asyncio.gather(*(each.close() for each in (*live, *events, *stalled)))
    return most


def test_a_client_that_takes_nothing_is_given_up(server: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "PATIENCE_S", 0.5)
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.connect(("127.0.0.1", server.port))
        lazy.sendall(f"GET {API}/live/raw.mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        wait_until(lambda: server.services.live.state.viewers[Kind.RAW] == 1)
        wait_until(lambda: not server.services.live.state.is_running)


def test_mjpeg_is_jpeg_after_jpeg(server: Running) -> None:
    with httpx2.stream("GET", f"{server.http}/live/overlay.mjpeg?width=240", trust_env=False) as answer:
        assert answer.headers["content-type"].startswith("multipart/x-mixed-replace")
        data = b""
        for piece in answer.iter_bytes():
            data += piece
            if data.count(b"--turnscan") > 2:
                break
    head, _, rest = data.partition(b"\r\n\r\n")
    length = int(head.split(b"Content-Length: ")[1])
    assert decode(rest[:length], (240, 180)).shape == (180, 240, 3)


def test_stripe_numbers_board_histogram_and_picture_belong_together(server: Running) -> None:
    services = server.services
    services.bench.switch("left", True)
    try:
        raw, stripe = asyncio.run(_pair(server))
    finally:
        services.bench.switch("left", False)
    # As docs/live.md takes a message apart.
    code, version, _, length = struct.unpack_from("<BBHI", stripe)
    assert (code, version) == (3, 1)
    there = unpack(stripe)
    assert there.body == stripe[8 + length :]
    assert there.facts["frame"] >= unpack(raw).facts["frame"]
    numbers = there.facts["numbers"]
    assert len(numbers["histogram"]) == 64
    assert numbers["exposure_us"] > 0.0
    assert numbers["focus"] > 0.0
    (laser, orientation, pixels, flags), *_ = there.stripes()
    assert (laser, orientation) == ("left", "vertical")
    assert len(pixels) == len(flags) == numbers["points"] > 20
    assert there.facts["marks"]["outlines"], "the limits of a scan"
    assert unpack(raw).body.startswith(b"\xff\xd8")


async def _pair(server: Running) -> tuple[bytes, bytes]:
    async with (
        asyncio.timeout(SOON_S),
        connect(f"{server.sockets}/live/raw", proxy=None) as raw,
        connect(f"{server.sockets}/live/stripe", proxy=None) as stripe,
    ):
        while True:
            await asyncio.gather(raw.send("next"), stripe.send("next"))
            picture, numbers = await raw.recv(decode=False), await stripe.recv(decode=False)
            if unpack(bytes(numbers)).facts["stripes"]:
                return bytes(picture), bytes(numbers)


def test_only_what_lies_in_the_polygon_counts_and_limits_can_be_set(server: Running) -> None:
    def change(**changes: object) -> dict[str, object]:
        answer = httpx2.patch(f"{server.http}/live/settings", json=changes, trust_env=False)
        assert answer.status_code == 200, answer.text
        told: dict[str, object] = answer.json()
        return told

    half = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]]
    limits = {"radius_mm": 40.0, "lowest_mm": 0.0, "highest_mm": 60.0}
    told = change(polygon=half, cylinder=limits)
    assert told["polygon"] == half
    assert told["cylinder"] == limits
    server.services.bench.switch("left", True)
    try:
        _, stripe = asyncio.run(_pair(server))
    finally:
        server.services.bench.switch("left", False)
    assert all((pixels[:, 1] <= 121.0).all() for _, _, pixels, _ in unpack(stripe).stripes())
    told = change(polygon=[], cylinder=None, threshold=30.0)
    assert (told["polygon"], told["cylinder"], told["threshold"]) == ([], None, 30.0)
    change(threshold=0.0)
    refused = httpx2.patch(f"{server.http}/live/settings", json={"polygon": [[0, 0]]}, trust_env=False)
    assert refused.status_code == 422
    assert "part of the picture" in refused.json()["title"]
