"""The 3D view, steered over the API."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from numpy.typing import NDArray

from app.api.scene import Corner, Scene
from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.errors import OptionError
from app.geometry.cloud import PointCloud
from app.main import create_app
from app.scanning.profile import Profile
from app.settings import Settings
from app.surface.ply import PlyWriter

NAME = "ball"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    folder = tmp_path_factory.mktemp("server")
    _put_scan(folder / "scans" / NAME)
    description = simulated_description("horus", object="sphere", width=320, height=240)
    with TestClient(create_app(Settings(folder), description), base_url="http://localhost") as client:
        yield client


def test_a_finished_scan_is_opened_coloured_and_cleared_away(client: TestClient) -> None:
    shown = client.post(f"{API}/view/show", json={"scan": NAME}).json()
    assert (shown["scan"], shown["cloud"], shown["points"], shown["live"]) == (NAME, "cloud.ply", 40, False)
    changed = client.patch(
        f"{API}/view", json={"colour": "laser", "point_size_mm": 1.5, "dark": False}
    ).json()
    assert (changed["colour"], changed["point_size_mm"], changed["dark"]) == ("laser", 1.5, False)
    assert client.post(f"{API}/view/look", json={"preset": "top"}).status_code == 204
    assert shown["nowhere"] == 0
    assert client.post(f"{API}/view/clear").json()["points"] == 0
    assert client.get(f"{API}/view").json()["scan"] == ""


def test_a_cloud_with_points_that_are_nowhere_is_taken_in_and_shown_without_them(
    client: TestClient, tmp_path: Path
) -> None:
    rows = "1 2 3\n4 5 nan\n7 8 9\n" + "1 2 inf\n"
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {n}\n" for n in "xyz")
    brought = client.post(f"{API}/scans/upload?file=holed.ply", content=f"{head}end_header\n{rows}".encode())
    assert brought.status_code == 201, brought.text
    name = brought.json()["name"]
    shown = client.post(f"{API}/view/show", json={"scan": name}).json()
    assert (shown["points"], shown["nowhere"]) == (2, 2)
    assert shown["extent"] == {"low": [1.0, 2.0, 3.0], "high": [7.0, 8.0, 9.0]}
    assert client.post(f"{API}/view/clear").json()["nowhere"] == 0


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("show", {"scan": "nowhere"}, 404),
        ("show", {"scan": NAME, "cloud": "../../secret.ply"}, 404),
        ("look", {"preset": "sideways"}, 422),
        ("look", {"preset": "top", "tab": "../x"}, 422),
    ],
)
def test_what_cannot_be_shown_is_told(
    client: TestClient, path: str, body: dict[str, str], status: int
) -> None:
    answer = client.post(f"{API}/view/{path}", json=body)
    assert answer.status_code == status
    assert answer.json()["title"]


class _Drawer:
    """Notes what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.viewers = 0

    def begin(self, laser_names: Sequence[str]) -> None:
        self.asked.append("begin")

    def add(self, profile: Profile) -> None:
        self.asked.append("add")

    def finish(self) -> None:
        self.asked.append("finish")

    def clear(self) -> None:
        self.asked.append("clear")

    def show_cloud(self, cloud: PointCloud) -> None:
        self.asked.append("show")

    def show_mesh(
        self,
        vertices: NDArray[np.float32],
        faces: NDArray[np.int32],
        colours: NDArray[np.uint8] | None = None,
    ) -> None:
        self.asked.append("show mesh")

    def colour_by(self, mode: str) -> None:
        raise OptionError(f"no {mode}")

    def set_point_size(self, size_mm: float) -> None: ...

    def set_dark(self, is_dark: bool) -> None: ...

    def look(self, preset: str, tab: str | None = None) -> None: ...

    def crop(self, low: Corner | None, high: Corner | None) -> None: ...

    def measure_at(self, tab: str, across: float, down: float) -> tuple[Corner, ...]:
        return ((across, down, 0.0),)

    def forget_measure(self) -> None: ...

    def pick_at(self, tab: str, across: float, down: float, before: Sequence[Corner] = ()) -> Corner:
        return across, down, 0.0

    def forget_picks(self) -> None: ...

    def view_matrix(self, tab: str) -> NDArray[np.float64]:
        return np.eye(4)


def test_a_part_is_shown_alone_until_another_cloud_is_shown(client: TestClient) -> None:
    shown = client.post(f"{API}/view/show", json={"scan": NAME}).json()
    assert shown["crop"] is None
    np.testing.assert_allclose(shown["extent"]["low"], [-30.0, -30.0, 20.0], atol=0.01)
    box = {"low": [-100.0, -100.0, 0.0], "high": [100.0, 100.0, 22.0]}
    assert client.put(f"{API}/view/crop", json=box).json()["crop"] == box
    assert client.put(f"{API}/view/crop", json=box | {"high": box["low"]}).status_code == 422
    assert client.get(f"{API}/view").json()["crop"] == box
    assert client.post(f"{API}/view/show", json={"scan": NAME}).json()["crop"] is None
    client.put(f"{API}/view/crop", json=box)
    assert client.delete(f"{API}/view/crop").json()["crop"] is None


def test_nothing_is_measured_where_nobody_looks(client: TestClient) -> None:
    place = {"tab": "nobody", "across": 0.5, "down": 0.5}
    answer = client.post(f"{API}/view/measure", json=place)
    assert (answer.status_code, answer.json()["hint"]) == (422, "Wait until the cloud is seen.")
    assert client.delete(f"{API}/view/measure").json()["distance_mm"] is None


def test_what_was_refused_is_not_remembered() -> None:
    scene = Scene(_Drawer())
    with pytest.raises(OptionError):
        scene.colour_by("smell")
    assert scene.shown.colour == "height"


def test_the_end_of_a_scan_does_not_disturb_another_that_is_looked_at() -> None:
    drawer = _Drawer()
    scene = Scene(drawer)
    scene.begin(("left",))
    scene.show_cloud("old", "cloud.ply", PointCloud.empty())
    scene.finish()
    assert drawer.asked == ["begin", "show"]
    assert not scene.shown.is_live


def _put_scan(folder: Path) -> None:
    folder.mkdir(parents=True)
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    points = np.column_stack([30.0 * np.cos(turn), 30.0 * np.sin(turn), 20.0 + turn]).astype(np.float32)
    ones = np.ones(40, np.float32)
    cloud = PointCloud(
        points, np.zeros_like(points), np.full((40, 3), 200, np.uint8), 0.02 * ones, np.zeros(40, np.uint8),
        np.degrees(turn).astype(np.float32), ones, ("left",),
    )  # fmt: skip
    with PlyWriter(folder / "cloud.ply", ("left",)) as ply:
        ply.append(cloud)
