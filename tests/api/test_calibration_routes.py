"""A calibration from its first picture to its export, with nothing but calls of the API."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from running_server import wait_until_connected

from app.api.versioned import API
from app.calibration.record import CalibrationRecord
from app.devices.bench_file import simulated_description
from app.jobs.events import CalibrationChanged
from app.main import create_app
from app.settings import Settings
from benchmarks.synthetic_views import surface_error_mm

_DEADLINE_S = 180.0


@pytest.fixture(scope="module")
def application(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    description = simulated_description("horus", object="sphere", width=480, height=360, rate=20.0)
    return create_app(Settings(tmp_path_factory.mktemp("server"), "simulated"), description)


@pytest.fixture(scope="module")
def client(application: FastAPI) -> Iterator[TestClient]:
    with TestClient(application, base_url="http://localhost") as client:
        wait_until_connected(application.state.services.bench)
        yield client


@pytest.fixture(scope="module")
def calibrated(client: TestClient, application: FastAPI) -> dict[str, Any]:
    """A person's calibration: begun, broken off half-way, taken up again; its job."""
    job = _post(client, "/calibrate", {"kind": "automatic"})
    state = _asked(client, job["id"])
    assert (state["instruction"]["code"], state["step"]) == ("place-board", "board")
    assert "Stand the board" in client.get(f"{API}/jobs/{job['id']}").json()["waits_for"]
    assert client.post(f"{API}/calibrate/{job['id']}/take").status_code == 409
    with application.state.services.runner.bus.listen() as listener:
        _post(client, "/bench/simulated/stage", {"stage": "board"})
        _post(client, f"/calibrate/{job['id']}/continue")
        state = _asked(client, job["id"], "place-board-again")
        heard = [event.calibration for event in listener.take() if isinstance(event, CalibrationChanged)]
    assert heard[-1].job_id == job["id"]
    _check_views(client, job["id"], state)
    _post(client, f"/jobs/{job['id']}/cancel")
    assert _ended(client, job["id"])["state"] == "cancelled"
    assert not client.get(f"{API}/calibrate/{job['id']}").json()["may_continue"]
    assert client.post(f"{API}/calibrate/{job['id']}/continue").status_code == 409
    (session,) = client.get(f"{API}/calibrate/sessions").json()
    assert session["pictures"] >= 15
    assert session["calibration"] == ""
    job = _post(client, "/calibrate/resume", {"session": session["name"]})
    again = _asked(client, job["id"], "place-board-again")
    assert [view["number"] for view in again["views"]] == [view["number"] for view in state["views"]]
    _post(client, "/bench/simulated/stage", {"stage": "board-again"})
    _post(client, f"/calibrate/{job['id']}/continue")
    _asked(client, job["id"], "clear-table")
    _post(client, "/bench/simulated/stage", {"stage": "nothing"})
    _post(client, f"/calibrate/{job['id']}/continue")
    ended = _ended(client, job["id"])
    assert ended["state"] == "done", ended
    return ended


def _check_views(client: TestClient, job_id: str, state: dict[str, Any]) -> None:
    """Each view can be looked at, struck out and taken back; the coverage follows."""
    views = state["views"]
    assert len(views) >= 5
    assert all(view["corners"] == 54 and len(view["outline"]) == 4 for view in views)
    assert state["taken"] == len(views)
    number = views[0]["number"]
    small = client.get(f"{API}/calibrate/{job_id}/views/{number}.jpg")
    image = cv2.imdecode(np.frombuffer(small.content, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == 320
    struck = _post(client, f"/calibrate/{job_id}/views/{number}/strike")
    assert struck["views"][0]["is_struck"]
    assert struck["views"][0]["reason"] == "struck out by hand"
    assert sum(map(sum, struck["coverage"])) == sum(map(sum, state["coverage"])) - 54
    back = _post(client, f"/calibrate/{job_id}/views/{number}/restore")
    assert not back["views"][0]["is_struck"]
    assert client.post(f"{API}/calibrate/{job_id}/views/99999/strike").status_code == 404


def test_it_is_true_proved_and_in_use(
    client: TestClient, calibrated: dict[str, Any], application: FastAPI
) -> None:
    result = calibrated["result"]
    assert result["in_use"]
    assert {finding["level"] for finding in result["proof"]["findings"]} <= {"green", "amber", "red"}
    shown = client.get(f"{API}/calibrations/current").json()
    assert shown["name"] == result["calibration"]
    assert shown["proof"]["findings"] == result["proof"]["findings"]
    assert shown["has_report"]
    assert shown["level"] == result["proof"]["level"]
    services = application.state.services
    assert surface_error_mm(services.bench.world.rig, services.calibration().rig) < 0.2
    assert set(services.calibration().extra["drift"]["table_mm"]) == {"left", "right"}
    state = client.get(f"{API}/calibrate/latest").json()
    assert (state["step"], state["instruction"]["code"]) == ("done", "done")
    assert all(view["rms_px"] is not None for view in state["views"] if not view["reason"])
    # Whoever scans next finds the object there again.
    assert client.get(f"{API}/bench/simulated/stage").json() == {"stage": "object"}


def test_a_step_can_be_done_again(client: TestClient, calibrated: dict[str, Any]) -> None:
    again = {"session": calibrated["result"]["session"], "redo": "board", "hands": "person"}
    job = _post(client, "/calibrate/resume", again)
    state = _asked(client, job["id"], "place-board")
    assert state["views"]
    assert {view["reason"] for view in state["views"]} == {"to be taken again"}
    _post(client, f"/jobs/{job['id']}/cancel")
    assert _ended(client, job["id"])["state"] == "cancelled"


def test_two_calibrations_are_compared(client: TestClient, calibrated: dict[str, Any]) -> None:
    name = calibrated["result"]["calibration"]
    other = json.loads(client.get(f"{API}/calibrations/{name}/calibration.json").content)
    other["axis"]["point_mm"][0] += 1.0
    asked = {"file": "other.json"}
    taken = client.post(f"{API}/calibrations/import", params=asked, content=json.dumps(other).encode()).json()
    names = {"first": name, "second": taken["calibration"]["name"]}
    compared = client.get(f"{API}/calibrations/compare", params=names).json()
    assert compared["axis"]["shift_mm"] == pytest.approx(1.0, abs=0.1)
    assert [plane["angle_deg"] for plane in compared["lasers"]] == [0.0, 0.0]
    assert compared["is_explained"] is False


def test_calibrations_are_removed_brought_back_and_chosen(
    client: TestClient, calibrated: dict[str, Any]
) -> None:
    name = calibrated["result"]["calibration"]
    removed = client.delete(f"{API}/calibrations/{name}").json()
    assert name not in [each["name"] for each in client.get(f"{API}/calibrations").json()]
    bin_names = [each["name"] for each in client.get(f"{API}/calibrations?removed=true").json()]
    assert removed["name"] in bin_names
    assert client.post(f"{API}/calibrations/bin/{removed['name']}/restore").json()["name"] == name
    used = _post(client, f"/calibrations/{name}/use")
    assert used["is_current"]
    report = client.get(f"{API}/calibrations/{name}/report.html")
    assert "Calibration report" in report.text
    assert "sandbox" in report.headers["content-security-policy"]


def test_what_is_exported_can_be_taken_in(
    client: TestClient, calibrated: dict[str, Any], tmp_path: Path
) -> None:
    name = calibrated["result"]["calibration"]
    own = client.get(f"{API}/calibrations/{name}/calibration.json").content
    (tmp_path / "rig.json").write_bytes(own)
    assert CalibrationRecord.load(tmp_path / "rig.json").lasers.keys() == {"left", "right"}
    same = client.post(f"{API}/calibrations/import", params={"file": "rig.json"}, content=own)
    assert same.status_code == 201
    assert same.json()["was_there"]
    yaml = client.get(f"{API}/calibrations/{name}/opencv.yml").content
    camera = client.post(f"{API}/calibrations/import", params={"file": "../cam.yml"}, content=yaml).json()
    assert not camera["was_there"]
    assert camera["calibration"]["missing"] == ["lasers", "axis"]
    assert not camera["calibration"]["is_current"]
    assert "Only the camera" in camera["calibration"]["notes"][0]


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("x.json", b"{}", "no calibration"),
        ("x.json", b"\xff\xfe", "UTF-8"),
        ("x.yml", b"%YAML:1.0\n---\nK: 1\n", "OpenCV"),
        ("calibration.json", json.dumps({"calibration_settings": {"a": 1}}).encode(), "calibration.json"),
        ("x.json", b" " * (16 * 2**20 + 1), "larger than 16 MB"),
    ],
)
def test_what_is_no_calibration_is_refused(client: TestClient, file: str, content: bytes, said: str) -> None:
    answer = client.post(f"{API}/calibrations/import", params={"file": file}, content=content)
    assert answer.status_code in (413, 422), answer.text
    assert said in answer.json()["title"]


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "said"),
    [
        ("GET", "/calibrations/..%2f..%2fetc", None, 404, ""),
        ("GET", "/calibrations/nope", None, 404, "nope"),
        ("DELETE", "/calibrations/2", None, 404, "no calibration"),
        ("POST", "/calibrations/bin/nope/restore", None, 404, "nope"),
        ("GET", "/calibrations/compare?first=nope&second=current", None, 404, "nope"),
        ("GET", "/calibrate/nope", None, 404, "nope"),
        ("POST", "/calibrate/resume", {"session": ".."}, 404, ".."),
        ("POST", "/calibrate", {"kind": "magic"}, 422, "kind"),
        ("POST", "/calibrate", {"ruler_mm": 10.0}, 422, "ruler_mm"),
        ("POST", "/bench/simulated/stage", {"stage": "elephant"}, 422, "stage"),
        ("GET", "/boards/print.pdf?kind=chessboard&columns=50&rows=50&spacing_mm=30", None, 422, ""),
    ],
)
def test_what_cannot_be_is_told_in_plain_words(
    client: TestClient, method: str, path: str, body: object, status: int, said: str
) -> None:
    answer = client.request(method, API + path, json=body)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert said in answer.json()["title"]


def test_the_board_is_printed(client: TestClient) -> None:
    board = client.get(f"{API}/boards/board.json").json()
    assert board["board"]["kind"] == "chessboard"
    assert client.get(f"{API}/boards/print.pdf?paper=letter").content.startswith(b"%PDF")
    wanted = "kind=charuco&columns=7&rows=5&spacing_mm=25"
    assert "<svg" in client.get(f"{API}/boards/print.svg?{wanted}").text


def _post(client: TestClient, path: str, body: object = None) -> dict[str, Any]:
    answer = client.post(API + path, json=body)
    assert answer.status_code == 200, answer.text
    told: dict[str, Any] = answer.json()
    return told


def _asked(client: TestClient, job_id: str, code: str = "") -> dict[str, Any]:
    """Wait until a person is asked for something; how it stands then."""
    state: dict[str, Any] = {}

    def is_asked() -> bool:
        ended = client.get(f"{API}/jobs/{job_id}").json()
        assert ended["ended"] is None, ended
        state.update(client.get(f"{API}/calibrate/{job_id}").json())
        return bool(state["waits_for_person"]) and code in ("", state["instruction"]["code"])

    _wait(is_asked)
    return state


def _ended(client: TestClient, job_id: str) -> dict[str, Any]:
    _wait(lambda: client.get(f"{API}/jobs/{job_id}").json()["ended"] is not None)
    shown: dict[str, Any] = client.get(f"{API}/jobs/{job_id}").json()
    return shown


def _wait(is_so: Callable[[], bool]) -> None:
    ends = time.monotonic() + _DEADLINE_S
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.02)
