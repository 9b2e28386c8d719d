"""Cleaning and measuring the clouds of the library over the API."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient

from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.geometry.cloud import PointCloud
from app.main import create_app
from app.settings import Settings
from app.surface.ply import write_ply
from app.surface.step import STEPS, parse_step


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    folder = tmp_path_factory.mktemp("server")
    _put_scan(folder / "scans" / "ball", _ball())
    larger = _ball()
    _put_scan(folder / "scans" / "larger", replace(larger, points=larger.points * np.float32(1.01)))
    _put_scan(folder / "scans" / "empty", PointCloud.empty())
    description = simulated_description("horus", object="sphere", width=320, height=240)
    with TestClient(create_app(Settings(folder), description), base_url="http://localhost") as client:
        yield client


def test_every_step_comes_with_its_settings_and_their_words(client: TestClient) -> None:
    kinds = {each["kind"]: each for each in client.get(f"{API}/surface/steps").json()}
    assert set(kinds) == set(STEPS)
    for kind, told in kinds.items():
        assert told["words"]
        for name, setting in told["settings"]["properties"].items():
            assert "default" in setting, (kind, name)
            assert setting.get("description"), (kind, name)
        defaults = {name: setting["default"] for name, setting in told["settings"]["properties"].items()}
        parse_step({"kind": kind, **defaults})


def test_steps_are_tried_shown_and_nothing_is_kept(client: TestClient) -> None:
    steps = [{"kind": "box", "low": [-50, -50, 0], "high": [50, 50, 50]}, {"kind": "statistical-outliers"}]
    told = client.post(f"{API}/surface/preview", json={"scan": "ball", "steps": steps}).json()
    assert [each["kind"] for each in told["effects"]] == ["box", "statistical-outliers"]
    assert (told["points"], told["shown"], told["cloud"]) == (6_000, True, "cloud.ply")
    assert told["effects"][0]["taken"] == pytest.approx(3_000, rel=0.1)
    assert told["left"] == told["effects"][-1]["after"]
    view = client.get(f"{API}/view").json()
    assert (view["scan"], view["points"]) == ("ball", told["left"])
    assert client.get(f"{API}/scans/ball").json()["points"] == 6_000


def test_what_would_go_is_shown_beside_what_stays(client: TestClient) -> None:
    wanted = {
        "scan": "ball", "marks": True,
        "steps": [{"kind": "box", "low": [-50, -50, 0], "high": [50, 50, 50]}, {"kind": "quality"}],
    }  # fmt: skip
    told = client.post(f"{API}/surface/preview", json=wanted).json()
    assert told["left"] < told["points"]
    view = client.get(f"{API}/view").json()
    assert (view["points"], view["colour"]) == (told["points"], "texture")


def test_a_cloud_is_measured_and_compared(client: TestClient) -> None:
    wanted = {
        "scan": "larger", "shape": "sphere", "ends": [[30, 0, 0], [-30, 0, 0]], "against": {"scan": "ball"},
    }  # fmt: skip
    told = client.post(f"{API}/surface/measure", json=wanted).json()
    assert told["fit"]["diameter_mm"] == pytest.approx(40.4, abs=0.01)
    assert told["distance"]["distance_mm"] == pytest.approx(40.4, abs=0.5)
    assert told["deviation"]["median_mm"] == pytest.approx(0.2, abs=0.05)
    assert sum(told["deviation"]["histogram"]["counts"]) == 6_000
    assert client.get(f"{API}/view").json()["colour"] == "texture"


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("preview", {"scan": "nowhere", "steps": []}, 404, "nowhere"),
        ("preview", {"scan": "ball", "cloud": "../x.ply", "steps": []}, 404, "x.ply"),
        ("preview", {"scan": "ball", "steps": [{"kind": "magic"}]}, 422, "magic"),
        ("preview", {"scan": "ball", "steps": [{"kind": "box", "low": [1, 2]}]}, 422, "low"),
        ("preview", {"scan": "ball", "steps": [{"kind": "thin", "size_mm": 1e-9}]}, 422, "too small"),
        ("measure", {"scan": "empty"}, 422, "no points"),
        ("measure", {"scan": "ball", "ends": [[1, 2], [3, 4, 5]]}, 422, "ends"),
    ],
)
def test_what_makes_no_sense_is_told(
    client: TestClient, path: str, body: dict[str, object], status: int, said: str
) -> None:
    answer = client.post(f"{API}/surface/{path}", json=body)
    assert answer.status_code == status
    assert said in answer.json()["title"]


def _put_scan(folder: Path, cloud: PointCloud) -> None:
    folder.mkdir(parents=True)
    write_ply(folder / "cloud.ply", cloud)


def _ball() -> PointCloud:
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(6_000, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ones = np.ones(6_000, np.float32)
    return PointCloud(
        np.float32(20.0) * normals, normals, np.full((6_000, 3), 128, np.uint8),
        0.03 * ones, np.zeros(6_000, np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip
