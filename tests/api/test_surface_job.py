"""Meshes over the API: made of a scan's cloud, listed, downloaded in any form, shown."""

import io
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from fastapi.testclient import TestClient

from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.geometry.cloud import PointCloud
from app.main import create_app
from app.settings import Settings
from app.surface.ply import write_ply

SCAN, MOVED = "ball", "moved"
_DEADLINE_S = 120.0
_GREY = 90


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    folder = tmp_path_factory.mktemp("server")
    (folder / "scans" / SCAN).mkdir(parents=True)
    write_ply(folder / "scans" / SCAN / "cloud.ply", _ball())
    (folder / "scans" / MOVED).mkdir()
    moved = _ball(2)
    aside = np.array([9.0, 0.0, 0.0], np.float32)
    write_ply(folder / "scans" / MOVED / "cloud.ply", replace(moved, points=moved.points + aside))
    description = simulated_description("horus", object="mug", width=320, height=240, rate=20.0)
    application = create_app(Settings(folder, "simulated"), description)
    with TestClient(application, base_url="http://localhost") as client:
        yield client


def test_a_cloud_becomes_a_mesh_to_download_and_to_show(client: TestClient) -> None:
    wanted = {
        "scan": SCAN,
        "steps": [{"kind": "quality", "least": 0.1}],
        "mesh": {"cell_mm": 1.2, "triangles": 900},
    }
    job = _ended(client, client.post(f"{API}/jobs/surface", json=wanted).json()["id"])
    assert job["state"] == "done", job["problem"]
    assert job["result"]["printing"]["findings"][0]["state"] == "good"
    meshes = client.get(f"{API}/scans/{SCAN}/meshes").json()
    assert [mesh["name"] for mesh in meshes] == [job["result"]["mesh"]]
    assert 0 < meshes[0]["triangles"] <= 900
    # Still one scan with one cloud.
    assert len(client.get(f"{API}/scans/{SCAN}").json()["clouds"]) == 1
    for form in ("ply", "stl", "3mf", "obj", "glb", "off"):
        got = client.get(meshes[0]["path"], params={"form": form})
        assert got.status_code == 200
        assert got.headers["content-disposition"].endswith(f'.{form}"')
        read = trimesh.load_scene(io.BytesIO(got.content), file_type=form).to_mesh()
        assert read.is_watertight
        assert len(read.faces) == meshes[0]["triangles"]
    untextured = client.get(meshes[0]["path"], params={"form": "obj-zip"})
    assert (untextured.status_code, untextured.json()["title"]) == (404, "The mesh has no texture.")
    inches = client.get(meshes[0]["path"], params={"form": "stl", "unit": "inch"})
    read = trimesh.load_mesh(io.BytesIO(inches.content), file_type="stl")
    assert read.extents[0] == pytest.approx(30.0 / 25.4, abs=0.02)
    assert client.post(f"{meshes[0]['path']}/show").status_code == 204
    shown = client.get(f"{API}/view").json()
    assert (shown["scan"], shown["cloud"]) == (SCAN, f"meshes/{meshes[0]['name']}")
    assert shown["extent"]["high"][2] == pytest.approx(30.0, abs=0.3)


def test_a_mesh_knows_how_it_was_made_its_cleaned_cloud_is_kept_and_it_is_erased(
    client: TestClient, tmp_path_factory: pytest.TempPathFactory
) -> None:
    presets = {each["preset"]: each for each in client.get(f"{API}/surface/presets/{SCAN}").json()}
    assert [step["kind"] for step in presets["print"]["steps"]] == [
        "quality",
        "table",
        "statistical-outliers",
    ]
    wanted = {
        "scan": SCAN, "cloud": "cloud.ply", "mesh": {"cell_mm": 1.2}, "texture_px": 512, "keeps_cloud": True,
    }  # fmt: skip
    result = _ended(client, client.post(f"{API}/jobs/surface", json=wanted).json()["id"])["result"]
    mesh = client.get(f"{API}/scans/{SCAN}/meshes").json()[-1]
    made = mesh["made"]
    assert (mesh["name"], made["order"]["preset"], made["cloud"]) == (result["mesh"], "print", "cloud.ply")
    got = {form: client.get(mesh["path"], params={"form": form}) for form in made["sizes"]}
    assert {form: len(answer.content) for form, answer in got.items()} == made["sizes"]
    assert mesh["has_texture"]
    assert made["order"]["texture_px"] == 512
    assert got["obj-zip"].headers["content-disposition"].endswith('.zip"')
    for form, ending in (("obj-zip", "zip"), ("glb", "glb")):
        thing = trimesh.load_scene(io.BytesIO(got[form].content), file_type=ending).to_mesh()
        assert len(thing.faces) == mesh["triangles"]
        material = thing.visual.material
        picture = np.asarray(material.image if form == "obj-zip" else material.baseColorTexture)
        assert picture.shape[0] <= 512
        assert np.median(picture) == _GREY
    clouds = {each["name"]: each for each in client.get(f"{API}/scans/{SCAN}").json()["clouds"]}
    assert clouds[result["cleaned"]]["made_by"] == "cleaned"
    assert clouds[result["cleaned"]]["points"] == made["used_points"] < clouds["cloud.ply"]["points"]
    assert client.delete(mesh["path"]).json()["freed_bytes"] > mesh["size_bytes"]
    assert not list(tmp_path_factory.getbasetemp().rglob(f"{mesh['name'].removesuffix('.ply')}.*"))
    assert mesh["name"] not in {each["name"] for each in client.get(f"{API}/scans/{SCAN}/meshes").json()}
    assert client.delete(mesh["path"]).status_code == 404
    nothing = {"scan": SCAN, "has_mesh": False}
    assert client.post(f"{API}/jobs/surface", json=nothing).status_code == 422


def test_scans_are_joined_into_a_new_one_by_places_that_were_shown(client: TestClient) -> None:
    places = [[10.0, 0.0, 8.0], [0.0, 12.0, 15.0], [-5.0, 0.0, 27.0]]
    pairs = [{"cloud": 1, "here": [x + 9.0, y, z], "there": [x, y, z]} for x, y, z in places]
    wanted = {
        "scans": [{"scan": SCAN, "cloud": "cloud.ply"}, {"scan": MOVED}], "title": "Both of them",
        "options": {"pairs": pairs},
    }  # fmt: skip
    job = _ended(client, client.post(f"{API}/jobs/join", json=wanted).json()["id"])
    assert job["state"] == "done", job["problem"]
    placed = job["result"]["placements"]
    assert [each["scan"] for each in placed] == [SCAN, MOVED]
    assert placed[0]["pose"][0][3] == 0.0
    assert 0.5 < placed[1]["overlap"] <= 1.0
    joined = client.get(f"{API}/scans/{job['result']['scan']}").json()
    assert (joined["title"], joined["status"], joined["clouds"][0]["made_by"]) == (
        "Both of them", "cloud", "joined",
    )  # fmt: skip
    # It was seen from all sides: no table is looked for, and nothing is stood on a base.
    presets = client.get(f"{API}/surface/presets/{joined['name']}").json()
    assert presets[0]["mesh"]["has_flat_base"] is False
    assert {"kind": "table"} not in presets[0]["steps"]
    twice = {"scans": [{"scan": MOVED}, {"scan": MOVED}], "title": "Twice"}
    assert client.post(f"{API}/jobs/join", json=twice).status_code == 422


def test_what_cannot_be_made_or_found_is_told(client: TestClient) -> None:
    for wrong in ({"steps": [{"kind": "magic"}]}, {"mesh": {"cell_mm": -1}}, {"preset": "eat"}):
        assert client.post(f"{API}/jobs/surface", json={"scan": SCAN, **wrong}).status_code == 422
    assert client.post(f"{API}/jobs/surface", json={"scan": "nothing"}).status_code == 404
    nothing = {"scan": SCAN, "steps": [{"kind": "quality", "least": 1.0, "most_sigma_mm": 1e-9}]}
    job = _ended(client, client.post(f"{API}/jobs/surface", json=nothing).json()["id"])
    assert job["problem"]["code"] == "surface"
    assert "steps left 0" in job["problem"]["message"]
    for path in ("missing.ply", "..%2Fcloud.ply", "missing.ply?form=stl"):
        assert client.get(f"{API}/scans/{SCAN}/meshes/{path}").status_code == 404
    assert client.post(f"{API}/scans/{SCAN}/meshes/missing.ply/show").status_code == 404


def _ball(seed: int = 1) -> PointCloud:
    """30 mm across, on the table, its underside not seen."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(8_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (15.0 + 0.02 * rng.normal(size=(8_000, 1))) + [0.0, 0.0, 15.0]
    ones = np.ones(len(points), np.float32)
    cloud = PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), _GREY, np.uint8),
        0.02 * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip
    return cloud.select(points[:, 2] > 2.0)


def _ended(client: TestClient, job: str) -> dict[str, Any]:
    deadline_s = time.monotonic() + _DEADLINE_S
    while time.monotonic() < deadline_s:
        found: dict[str, Any] = client.get(f"{API}/jobs/{job}").json()
        if found["ended"] is not None:
            return found
        time.sleep(0.1)
    raise AssertionError("the job did not end")
