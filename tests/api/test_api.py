"""The API on a small simulated bench: a scan from beginning to download, and every refusal a problem."""

import io
import json
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from running_server import wait_until_connected

from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.main import create_app
from app.settings import Settings
from app.surface.ply_reader import read_ply


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    description = simulated_description("horus", object="sphere", width=320, height=240, rate=20.0)
    application = create_app(Settings(tmp_path_factory.mktemp("server"), "simulated"), description)
    with TestClient(application, base_url="http://localhost") as client:
        wait_until_connected(application.state.services.bench)
        yield client


def test_the_bench_is_shown(client: TestClient) -> None:
    bench = client.get(f"{API}/bench").json()
    assert bench["turntable"].startswith("Horus")
    assert bench["lasers"] == ["left", "right"]


def test_lasers_and_table_obey_and_an_emergency_stop_ends_all(client: TestClient) -> None:
    assert client.post(f"{API}/bench/lasers/left", json={"on": True}).json()["lasers_on"] == ["left"]
    assert client.post(f"{API}/bench/table", json={"angle_deg": 9.0}).json()["angle_deg"] == 9.0
    assert client.post(f"{API}/bench/stop").json()["lasers_on"] == []
    client.post(f"{API}/bench/table", json={"angle_deg": 0.0})


def test_a_scan_from_its_order_to_its_download(client: TestClient, tmp_path: Path) -> None:
    wanted = {"title": "A ball", "steps": 12, "lasers": ["left"]}
    job = client.post(f"{API}/jobs/scan", json=wanted).json()
    ended = _ended(client, job["id"])
    assert ended["state"] == "done", ended
    scan = client.get(f"{API}/scans/{ended['scan']}").json()
    assert (scan["title"], scan["pictures"]) == ("A ball", 24)
    cloud = client.get(f"{API}/scans/{scan['name']}/cloud.ply")
    (tmp_path / "ball.ply").write_bytes(cloud.content)
    assert len(read_ply(tmp_path / "ball.ply").points) == scan["clouds"][-1]["points"] > 500
    packed = client.get(f"{API}/scans/{scan['name']}/recording.zip").content
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        assert archive.testzip() is None
        assert any(name.endswith("recording.json") for name in archive.namelist())
    assert client.get(f"{API}/scans/{scan['name']}/thumbnail.png").content.startswith(b"\x89PNG")
    again = client.post(f"{API}/jobs/reconstruct", json={"scan": scan["name"]}).json()
    assert _ended(client, again["id"])["state"] == "done"
    named = client.patch(f"{API}/scans/{scan['name']}", json={"title": "Ball", "note": "red"}).json()
    assert (named["title"], named["note"]) == ("Ball", "red")
    key = client.delete(f"{API}/scans/{scan['name']}").json()["key"]
    assert client.get(f"{API}/scans/{scan['name']}").status_code == 404
    assert client.post(f"{API}/scans/bin/{key}/restore").json()["title"] == "Ball"


def test_a_cancelled_scan_is_gone_on_with(client: TestClient) -> None:
    job = client.post(f"{API}/jobs/scan", json={"title": "Half", "steps": 60, "lasers": ["left"]}).json()
    _wait(lambda: client.get(f"{API}/jobs/{job['id']}").json()["done"] > 5)
    busy = client.post(f"{API}/bench/lasers/left", json={"on": True})
    assert busy.status_code == 409
    client.post(f"{API}/jobs/{job['id']}/cancel")
    assert _ended(client, job["id"])["state"] == "cancelled"
    assert client.get(f"{API}/scans/{job['scan']}").json()["status"] == "paused"
    more = client.post(f"{API}/jobs/resume-scan", json={"scan": job["scan"]}).json()
    ended = _ended(client, more["id"])
    assert ended["state"] == "done", ended
    assert ended["result"]["pictures"] == 120


def test_events_come_over_the_socket(client: TestClient) -> None:
    with client.websocket_connect(f"{API}/events", headers={"host": "localhost"}) as socket:
        job = client.post(f"{API}/jobs/checkup", json={"only": ["board"]}).json()
        heard: list[dict[str, Any]] = []
        while not any(event.get("job", {}).get("ended") for event in heard):
            heard.append(json.loads(socket.receive_text()))
    mine = [event["job"] for event in heard if event["type"] == "job-changed"]
    assert mine[-1]["id"] == job["id"]
    assert mine[-1]["state"] == "done"


def test_live_pictures_come_when_they_are_asked_for(client: TestClient) -> None:
    with client.websocket_connect(f"{API}/live/overlay?width=320", headers={"host": "localhost"}) as socket:
        for _ in range(2):
            socket.send_text("next")
            assert len(socket.receive_bytes()) > 1000


def test_live_settings_change_and_refuse(client: TestClient) -> None:
    assert client.patch(f"{API}/live/settings", json={"threshold": 25.0}).json()["threshold"] == 25.0
    assert client.patch(f"{API}/live/settings", json={"threshold": 0.0}).json()["threshold"] is None
    _check_problem(client.patch(f"{API}/live/settings", json={"channel": "purple"}), 422, "purple")


def test_the_pages_are_served(client: TestClient) -> None:
    start = client.get("/")
    assert "Turnscan" in start.text
    assert "default-src 'self'" in start.headers["content-security-policy"]
    assert client.get("/view/").status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "said"),
    [
        ("GET", "/jobs/nope", None, 404, "no job 'nope'"),
        ("POST", "/jobs/nope/cancel", None, 404, "no job"),
        ("GET", "/scans/nope", None, 404, "nope"),
        ("DELETE", "/scans/..", None, 404, ""),
        ("GET", "/scans/%2e%2e%2fetc/cloud.ply", None, 404, ""),
        ("POST", "/scans/bin/nope/restore", None, 404, "nope"),
        ("POST", "/jobs/resume-scan", {"scan": "../../etc"}, 404, "etc"),
        ("POST", "/jobs/scan", {"steps": 0}, 422, "steps"),
        ("POST", "/jobs/scan", {"lasers": ["middle"]}, 422, "'middle'"),
        ("POST", "/jobs/scan", {"title": "\x00"}, 400, "title"),
        ("POST", "/jobs/checkup", {"only": ["nose"]}, 200, ""),
        ("POST", "/bench/lasers/middle", {"on": True}, 422, "'middle'"),
        ("POST", "/bench/table", {"angle_deg": 1e9}, 422, "angle_deg"),
        ("GET", "/live/purple.mjpeg", None, 422, "kind"),
        ("GET", "/nowhere", None, 404, ""),
    ],
)
def test_what_is_wrong_is_answered_as_a_problem(
    client: TestClient, method: str, path: str, body: object, status: int, said: str
) -> None:
    answer = client.request(method, API + path, json=body)
    if status == 200:
        assert _ended(client, answer.json()["id"])["problem"]["code"] == "option"
        return
    _check_problem(answer, status, said)


@pytest.mark.parametrize(
    "headers", [{"host": "evil.example"}, {"origin": "http://evil.example"}, {"origin": "null"}]
)
def test_other_hosts_and_pages_are_refused(client: TestClient, headers: dict[str, str]) -> None:
    _check_problem(client.post(f"{API}/bench/stop", headers=headers), 403, "own pages")


def _check_problem(answer: Any, status: int, said: str) -> None:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert said in answer.json()["title"]


def _ended(client: TestClient, job_id: str) -> dict[str, Any]:
    _wait(lambda: client.get(f"{API}/jobs/{job_id}").json()["ended"] is not None)
    shown: dict[str, Any] = client.get(f"{API}/jobs/{job_id}").json()
    return shown


def _wait(is_so: Callable[[], bool], timeout_s: float = 300.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.01)
