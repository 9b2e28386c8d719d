"""Events, the emergency stop and the dead-man: what keeps a person informed and safe."""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx2
import pytest
from running_server import SOON_S, Running, running_server, wait_until
from starlette.types import Message, Receive, Scope, Send
from websockets.asyncio.client import ClientConnection, connect

from app.api.traffic import Traffic, TrafficCounted
from app.devices.bench import Bench
from app.devices.bench_file import read_bench_file, simulated_description
from app.live.dead_man import DeadMan

_BLOCKED = 60


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_server(tmp_path_factory.mktemp("server")) as server:
        yield server


def _asked(server: Running, method: str, path: str, body: object = None, status: int = 200) -> Any:
    answer = httpx2.request(method, server.http + path, json=body, timeout=SOON_S, trust_env=False)
    assert answer.status_code == status, answer.text
    return answer.json()


async def _heard(socket: ClientConnection, is_it: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    while True:
        event: dict[str, Any] = json.loads(await socket.recv())
        if is_it(event):
            return event


def test_a_listener_hears_how_everything_stands_then_what_changes_without_asking(server: Running) -> None:
    async def listen() -> None:
        async with asyncio.timeout(SOON_S), connect(f"{server.sockets}/events", proxy=None) as socket:
            state = json.loads(await socket.recv())
            assert state["type"] == "state"
            assert state["bench"]["lasers"] == ["left", "right"]
            assert state["bench"]["table"]["driver"] == "simulated"
            assert state["jobs"] == []
            server.services.bench.switch("right", True)
            lit = await _heard(socket, lambda event: event["type"] == "bench-changed")
            assert lit["bench"]["lasers_on"] == ["right"]
            server.services.bench.switch("right", False)
            counted = await _heard(socket, lambda event: event["type"] == "counters" and event["frames"] > 0)
            assert counted["viewers"]["events"] == 1
            assert counted["bytes_sent"] > 0

    asyncio.run(listen())


def test_server_sent_events_are_the_same_and_their_ids_grow(server: Running) -> None:
    with httpx2.stream("GET", f"{server.http}/events/stream", timeout=SOON_S, trust_env=False) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        numbers, events = [], []
        for line in answer.iter_lines():
            if line.startswith("id: "):
                numbers.append(int(line[4:]))
            if line.startswith("data: "):
                events.append(json.loads(line[6:]))
            if len(events) >= 3:
                break
    assert events[0]["type"] == "state"
    assert numbers == sorted(set(numbers))


def test_the_emergency_stop_works_while_everything_else_hangs(
    server: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    services, release = server.services, threading.Event()
    bench = services.bench

    def hanging(angle_deg: float) -> float:
        release.wait(SOON_S)
        return angle_deg

    monkeypatch.setattr(bench.turntable, "move_to", hanging)
    monkeypatch.setattr(bench.camera, "fresh_frame", lambda **_: hanging(0.0))
    bench.switch("left", True)

    async def press() -> None:
        limits = httpx2.Limits(max_connections=None)
        async with httpx2.AsyncClient(timeout=SOON_S, limits=limits, trust_env=False) as client:
            turns = [
                asyncio.create_task(client.post(f"{server.http}/bench/table", json={"angle_deg": 5.0}))
                for _ in range(_BLOCKED)
            ]
            # Until no thread of those that other requests use is left.
            while True:
                try:
                    async with asyncio.timeout(1.0):
                        await client.get(f"{server.http}/bench")
                except TimeoutError:
                    break
            stopped = await client.post(f"{server.http}/bench/stop")
            assert stopped.json()["lasers_on"] == []
            bench.switch("left", True)
            async with connect(f"{server.sockets}/events", proxy=None) as socket:
                await socket.send("stop")
                deadline_s = time.monotonic() + SOON_S
                while bench.lasers_on:
                    assert time.monotonic() < deadline_s, "a stop by message does the same"
                    await asyncio.sleep(0.01)
            release.set()
            await asyncio.gather(*turns)

    try:
        asyncio.run(press())
    finally:
        release.set()


def test_the_emergency_stop_ends_the_job_that_holds_the_bench_and_nothing_is_lit_again(
    server: Running,
) -> None:
    job = _asked(server, "POST", "/jobs/scan", {"title": "Stopped", "steps": 200, "lasers": ["left"]})
    wait_until(lambda: _asked(server, "GET", f"/jobs/{job['id']}")["done"] > 2)
    _asked(server, "POST", "/bench/stop")
    wait_until(lambda: _asked(server, "GET", f"/jobs/{job['id']}")["ended"] is not None)
    assert _asked(server, "GET", f"/jobs/{job['id']}")["state"] == "cancelled"
    bench = _asked(server, "GET", "/bench")
    assert (bench["lasers_on"], bench["holder"]) == ([], "")
    # The bench is anybody's again.
    assert _asked(server, "POST", "/bench/lasers/left", {"on": True})["lasers_on"] == ["left"]
    _asked(server, "POST", "/bench/lasers/left", {"on": False})


def test_the_table_jogs_is_zeroed_and_the_board_is_talked_to(server: Running) -> None:
    _asked(server, "POST", "/bench/zero", {"angle_deg": 0.0})
    assert _asked(server, "POST", "/bench/table", {"by_deg": 9.0})["angle_deg"] == pytest.approx(9.0)
    turned = _asked(server, "POST", "/bench/table", {"by_deg": -4.5, "speed_deg_s": 20.0})
    assert turned["angle_deg"] == pytest.approx(4.5, abs=0.3)
    assert _asked(server, "POST", "/bench/zero", {"angle_deg": 90.0})["angle_deg"] == pytest.approx(90.0)
    _asked(server, "POST", "/bench/motor", {"on": False})
    _asked(server, "POST", "/bench/table", {}, 422)
    refused = _asked(server, "POST", "/bench/console", {"line": "$I"}, 422)
    assert "understood" in refused["hint"]
    said = _asked(server, "POST", "/bench/console", {"line": "$I", "understood": True})
    assert any("ok" in line for line in said["lines"])
    _asked(server, "POST", "/bench/console", {"line": "M71T1", "understood": True})
    assert _asked(server, "GET", "/bench")["lasers_on"] == []


def test_controls_are_read_back_kept_for_their_use_and_the_exposure_is_found(server: Running) -> None:
    controls = {each["name"]: each for each in _asked(server, "GET", "/bench/camera/controls")}
    assert controls["exposure"]["present"]
    assert not controls["brightness"]["present"], "the simulated camera has none"
    wanted = {"use": "texture", "values": {"exposure": 7000.0}}
    controls = {each["name"]: each for each in _asked(server, "PATCH", "/bench/camera/controls", wanted)}
    assert controls["exposure"]["value"] == controls["exposure"]["uses"]["texture"]
    refused = _asked(server, "PATCH", "/bench/camera/controls", {"values": {"brightness": 1.0}}, 409)
    assert "brightness" in refused["title"]
    found = _asked(server, "POST", "/bench/camera/find-exposure", {"laser": "left"})
    assert found["clipped"] < 0.02
    assert found["control"]["uses"]["laser"] == found["control"]["value"]
    assert _asked(server, "GET", "/bench")["lasers_on"] == []


def test_each_device_is_tried_with_one_call(server: Running) -> None:
    for what in ("camera", "table", "lasers"):
        tried = _asked(server, "POST", f"/bench/try/{what}")
        assert tried["ok"], tried
        assert tried["said"]


def test_those_who_watch_over_servers_are_told_numbers(server: Running) -> None:
    port = server.port
    text = httpx2.get(f"http://localhost:{port}/metrics", trust_env=False).text
    assert 'turnscan_viewers{kind="overlay"} 0.0' in text
    assert 'turnscan_jobs_ended_total{kind="scan",state="cancelled"} 1.0' in text
    lit_s = next(
        line for line in text.splitlines() if line.startswith('turnscan_laser_on_seconds_total{laser="left"}')
    )
    assert float(lit_s.split()[-1]) > 0.0
    for name in ("turnscan_camera_frames_total", "turnscan_sent_bytes_total", "process_cpu_seconds_total"):
        assert name in text


def test_lasers_that_nobody_watches_go_off_and_those_that_are_watched_stay() -> None:
    went_off: list[tuple[str, ...]] = []
    looks = 0

    def seen_s(at_s: Callable[[], float]) -> Callable[[], float]:
        def seen() -> float:
            nonlocal looks
            looks += 1
            return at_s()

        return seen

    with Bench.build(simulated_description(width=320, height=240)) as bench:
        bench.connect_turntable()

        def watch(at_s: Callable[[], float], is_so: Callable[[], bool]) -> None:
            nonlocal looks
            looks = 0
            with DeadMan(bench, seen_s(at_s), went_off.append, limit_s=30.0, period_s=0.01):
                wait_until(is_so)

        bench.switch("left", True)
        watch(time.monotonic, lambda: looks > 5)
        assert bench.lasers_on == ("left",), "somebody is there"
        with bench.lease("a job"):
            bench.switch("right", True)
            watch(lambda: time.monotonic() - 31.0, lambda: looks > 5)
            assert bench.lasers_on == ("right",), "a job minds its own"
        bench.switch("left", True)
        watch(lambda: time.monotonic() - 31.0, lambda: went_off == [("left",)])
        assert not bench.lasers_on


def test_a_page_in_the_background_and_half_an_upload_are_nobody() -> None:
    traffic, computing, computed, seen_s = Traffic(), asyncio.Event(), asyncio.Event(), 0.0

    async def application(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.body", "body": b"x"})
        await receive()
        computing.set()
        await computed.wait()

    def is_there() -> bool:
        before_s = traffic.seen_s
        while time.monotonic() <= before_s:
            pass
        return traffic.seen_s > before_s

    async def sent(message: Message) -> None:
        nonlocal seen_s
        # Some time passes until it is on its way.
        seen_s = traffic.seen_s
        while time.monotonic() <= seen_s:
            pass

    async def asked(method: str, path: str) -> tuple[asyncio.Task[None], asyncio.Event]:
        said = asyncio.Event()
        computing.clear()
        computed.clear()

        async def receive() -> Message:
            await said.wait()
            return {"type": "http.request"}

        scope = {"type": "http", "method": method, "path": f"/api/v1{path}"}
        serving = asyncio.create_task(TrafficCounted(application, traffic)(scope, receive, sent))
        await asyncio.sleep(0)
        return serving, said

    async def watch() -> None:
        for path, looks in (("/events/stream", False), ("/live/raw.mjpeg", True)):
            serving, said = await asked("GET", path)
            assert (traffic.seen_s > seen_s) is looks, path
            said.set()
            computed.set()
            await serving
        serving, said = await asked("POST", "/scans/upload")
        assert not is_there(), "the rest of the upload may never come"
        said.set()
        await computing.wait()
        assert is_there(), "whoever has ordered something waits for it"
        computed.set()
        await serving
        assert not is_there()

    asyncio.run(watch())


def test_another_bench_is_chosen_while_the_server_runs(server: Running) -> None:
    listed = _asked(server, "GET", "/devices")
    assert {"ciclop", "fabscan", "atlas", "grbl", "marlin", "simulated"} <= {
        p["name"] for p in listed["presets"]
    }
    assert listed["bench"] == "simulated"
    missing = {"board": "horus", "port": "/etc/passwd", "camera": "simulated"}
    assert "no port" in _asked(server, "POST", "/devices/choose", missing, 404)["title"]
    by_hand = {"name": "By hand", "board": "manual", "camera": "simulated", "mirror": True}
    by_hand |= {"lasers": [{"name": "only", "channel": 1, "colour": "green"}]}
    chosen = _asked(server, "POST", "/devices/choose", by_hand)
    assert (chosen["bench"]["name"], chosen["bench"]["lasers"]) == ("By hand", ["only"])
    assert chosen["bench"]["camera"]["connected"]
    spec = _asked(server, "GET", "/devices")["bench"]
    assert read_bench_file(spec).camera.mirror
    # The pictures are those of the new camera.
    assert _asked(server, "POST", "/bench/try/camera")["ok"]
    with httpx2.stream("GET", f"{server.http}/live/raw.mjpeg", timeout=SOON_S, trust_env=False) as answer:
        assert next(answer.iter_bytes()).startswith(b"--turnscan")
    back = _asked(server, "POST", "/devices/choose", {"board": "simulated", "camera": "simulated"})
    assert back["bench"]["lasers"] == ["left", "right"]
    assert back["problem"] == ""
