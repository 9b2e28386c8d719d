"""Jobs over the API: their options, what they make, how they are taken up again and off the list."""

import random
import time
from collections import namedtuple
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from running_server import wait_until_connected

from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.main import create_app
from app.settings import Settings
from app.surface.ply_reader import read_ply
from benchmarks.killed_scans import KilledServer, scan_with_kills

_STEPS = 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("server")


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[TestClient]:
    description = simulated_description("horus", object="mug", width=320, height=240, rate=20.0)
    application = create_app(Settings(folder, "simulated"), description)
    with TestClient(application, base_url="http://localhost") as client:
        wait_until_connected(application.state.services.bench)
        yield client


@pytest.fixture(scope="module")
def scan(client: TestClient) -> str:
    """The name of a scan with both lasers in one picture."""
    wanted = {"title": "Mug", "steps": _STEPS, "together": True, "texture_every": 4, "above_mm": 5.0}
    ended = _done(client, "scan", wanted)
    assert ended["result"]["pictures"] == 2 * _STEPS + 2
    return str(ended["scan"])


def test_the_next_scan_is_estimated_as_the_last_one_went(client: TestClient, scan: str) -> None:
    wanted = {"steps": 2 * _STEPS, "together": True, "texture_every": 4}
    expected = client.post(f"{API}/jobs/scan/estimate", json=wanted).json()
    assert expected["is_measured"]
    assert expected["shots"] == 2 * (2 * _STEPS + 2)
    last = next(job for job in client.get(f"{API}/jobs").json() if job["kind"] == "scan")
    assert expected["points"] == pytest.approx(2 * last["result"]["points"], rel=0.01)
    stacked = client.post(f"{API}/jobs/scan/estimate", json=wanted | {"exposures_us": [2000, 4000]}).json()
    assert stacked["shots"] == 2 * (4 * _STEPS + 2)
    assert stacked["points"] == pytest.approx(expected["points"], rel=0.01)
    turn = {"mode": "continuous", "seconds_per_turn": 10.0, "lasers": ["left"]}
    expected = client.post(f"{API}/jobs/scan/estimate", json=turn).json()
    assert not expected["is_measured"]
    assert expected["capture_s"] > 20.0
    assert expected["size_bytes"] > 1_000_000


def test_a_scan_that_cannot_fit_on_the_disk_is_refused_with_numbers(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10**9, 10**9 - 10**6, 10**6))
    before = [each["name"] for each in client.get(f"{API}/scans").json()]
    answer = client.post(f"{API}/jobs/scan", json={"steps": 200})
    assert answer.status_code == 507
    assert answer.json()["type"] == "turnscan:no-room"
    assert "1 MB are free" in answer.json()["title"]
    assert [each["name"] for each in client.get(f"{API}/scans").json()] == before


def test_a_cloud_gets_colours_from_a_round_with_the_lasers_off(
    client: TestClient, scan: str, folder: Path
) -> None:
    here = folder / "scans" / scan
    before = read_ply(here / "cloud.ply")
    assert before.points[:, 2].min() > 4.9
    ended = _done(client, "texture", {"scan": scan, "pictures": 4})
    after = read_ply(here / ended["result"]["cloud"])
    assert np.array_equal(after.points, before.points)
    assert not np.array_equal(after.colours, before.colours)
    # The mug is painted; what stays black was seen by no picture.
    assert np.mean(after.colours.any(axis=1)) > 0.9


def test_clouds_are_exported_and_downloaded(client: TestClient, scan: str, folder: Path) -> None:
    cloud = read_ply(folder / "scans" / scan / "cloud.ply")
    for form in ("xyz", "ply", "ply-ascii"):
        job = _done(client, "export", {"scan": scan, "form": form, "cloud": "cloud.ply"})
        got = client.get(f"{API}/jobs/{job['id']}/file")
        assert got.status_code == 200
        path = folder / f"got.{form}"
        path.write_bytes(got.content)
        points = np.loadtxt(path)[:, :3] if form == "xyz" else read_ply(path).points
        assert points == pytest.approx(cloud.points, abs=1e-4)
    unknown = client.post(f"{API}/jobs/export", json={"scan": scan, "cloud": "../../secret"}).json()
    assert _ended(client, unknown["id"])["problem"]["code"] == "not-there"
    assert client.get(f"{API}/jobs/{unknown['id']}/file").status_code == 404


def test_a_scan_is_computed_again_with_another_detector_and_region(client: TestClient, scan: str) -> None:
    wanted = {"scan": scan, "calibration": "own", "detector": "centroid", "above_mm": 20.0, "below_mm": 40.0}
    again = _done(client, "reconstruct", wanted)
    retried = _ended(client, client.post(f"{API}/jobs/{again['id']}/retry", json={}).json()["id"])
    assert retried["result"]["points"] == again["result"]["points"] > 0
    left = [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]]
    chosen = {"polygon": left, "threshold": 30.0, "channel": "red"}
    part = _done(client, "reconstruct", wanted | chosen)
    assert 0 < part["result"]["points"] < again["result"]["points"]
    for wrong in ({"detector": "nose"}, {"above_mm": 2.0, "below_mm": 1.0}, {"calibration": "nowhere"},
                  {"polygon": left[:2]}, {"channel": "difference"}):  # fmt: skip
        assert client.post(f"{API}/jobs/reconstruct", json={"scan": scan, **wrong}).status_code == 422


def test_a_cancelled_scan_is_retried_where_it_was_and_jobs_leave_the_list(client: TestClient) -> None:
    job = client.post(f"{API}/jobs/scan", json={"title": "Half", "steps": 40, "lasers": ["left"]}).json()
    assert client.delete(f"{API}/jobs/{job['id']}").status_code == 409
    _wait(lambda: client.get(f"{API}/jobs/{job['id']}").json()["done"] > 5)
    client.post(f"{API}/jobs/{job['id']}/cancel")
    ended = _ended(client, job["id"])
    # Another attempt at this test has left scans of that name.
    assert (ended["state"], ended["can_resume"], ended["scan"][:4]) == ("cancelled", True, "half")
    # Moved in between, the table comes back to where the scan needs it.
    client.post(f"{API}/bench/table", json={"angle_deg": 200.0})
    more = client.post(f"{API}/jobs/{job['id']}/retry", json={}).json()
    pressed_twice = client.post(f"{API}/jobs/{job['id']}/retry", json={})
    assert (pressed_twice.status_code, "already" in pressed_twice.json()["title"]) == (409, True)
    ended = _ended(client, more["id"])
    assert (ended["state"], ended["result"]["pictures"]) == ("done", 80), ended
    assert not client.get(f"{API}/jobs/{job['id']}").json()["can_resume"]
    assert client.delete(f"{API}/jobs/{job['id']}").status_code == 200
    assert client.get(f"{API}/jobs/{job['id']}").status_code == 404
    assert client.get(f"{API}/scans/{ended['scan']}").status_code == 200


def test_a_scan_whose_program_is_killed_goes_on(tmp_path: Path) -> None:
    server = KilledServer(tmp_path / "killed", (480, 360))
    try:
        server.start()
        outcome = scan_with_kills(server, "ball", 12, 1, random.Random(4))
    finally:
        server.kill()
    assert outcome.not_resumed == ()
    assert (outcome.shots, outcome.repeated) == (36, 0)
    assert outcome.in_vain <= outcome.kills
    assert outcome.off_deg < 0.06
    assert outcome.rms_mm < 0.1, outcome


def _done(client: TestClient, kind: str, wanted: dict[str, Any]) -> dict[str, Any]:
    answer = client.post(f"{API}/jobs/{kind}", json=wanted)
    assert answer.status_code == 200, answer.text
    ended = _ended(client, answer.json()["id"])
    assert ended["state"] == "done", ended
    return ended


def _ended(client: TestClient, job_id: str) -> dict[str, Any]:
    _wait(lambda: client.get(f"{API}/jobs/{job_id}").json()["ended"] is not None)
    shown: dict[str, Any] = client.get(f"{API}/jobs/{job_id}").json()
    return shown


def _wait(is_so: Callable[[], bool], timeout_s: float = 300.0) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.01)
