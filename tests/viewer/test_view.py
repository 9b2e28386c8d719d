"""The live view as a viewer sees it who speaks viser's protocol through our own server."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from served_view import profile, served, wait_until, watch

from app.errors import OptionError
from app.geometry.arrays import unit
from app.geometry.transform import RigidTransform
from app.simulation.rig import standard_rig
from app.viewer.cloud_view import CloudView
from app.viewer.colouring import ColourMode
from app.viewer.eyes import FOV_RAD, PRESETS, place
from app.vision.board import BoardSpec


@pytest.fixture
def view() -> Iterator[CloudView]:
    with CloudView() as view:
        yield view
        assert view.problem == ""


def test_a_viewer_sees_the_points_grow_and_at_the_end_exactly(view: CloudView) -> None:
    with served(view) as port, watch(port) as viewer:
        view.begin(("left", "right"))
        for number in range(10):
            view.add(profile(number))
        assert view.settle()
        wait_until(lambda: len(viewer.points()) == 7000)
        assert "/table/scan/newest" in viewer.nodes
        assert {node.props["points"].dtype for node in viewer.nodes.values() if "points" in node.props
                and node.kind == "PointCloudMessage"} == {np.dtype(np.float16)}  # fmt: skip
        view.finish()
        assert view.settle()
        wait_until(lambda: "/table/scan/newest" not in viewer.nodes and len(viewer.clouds()) == 1)
        truth = np.concatenate([profile(number).cloud.points for number in range(10)])
        assert len(viewer.points()) > 0.9 * len(truth)
        lowest = np.sort(viewer.points()[:, 2])[[0, -1]]
        np.testing.assert_allclose(lowest, [0.0, 80.0], atol=1e-4)


def test_who_comes_late_sees_all_that_is_there(view: CloudView) -> None:
    view.show_rig(standard_rig(640, 480).rig)
    view.begin(("left", "right"))
    with served(view) as port, watch(port) as early:
        for number in range(200):
            view.add(profile(number, points=100))
            if number % 50 == 0:
                assert view.settle()
        view.turn_to(1.0)
        assert view.settle()
        wait_until(lambda: len(early.points()) == 20_000)
        with watch(port) as late:
            wait_until(lambda: late.has_replayed)
            wait_until(lambda: late.nodes.keys() == early.nodes.keys())
            assert len(late.points()) == 20_000
            assert late.nodes["/table"].wxyz == early.nodes["/table"].wxyz


def test_the_scene_of_a_calibrated_scanner_is_complete(view: CloudView) -> None:
    rig = standard_rig(640, 480).rig
    spec = BoardSpec("chessboard", 9, 6, 8.0)
    view.show_rig(rig)
    view.show_boards(spec, [rig.axis.camera_from_table, RigidTransform.identity()])
    view.light(["right"])
    with served(view) as port, watch(port) as viewer:
        wait_until(lambda: "/boards/01" in viewer.nodes)
        wait_until(lambda: viewer.nodes["/lasers/1"].props["opacity"] > 0.2)
        assert viewer.nodes["/lasers/0"].props["opacity"] < 0.1
        assert {"/table/disc", "/table/ticks", "/grid", "/axis", "/camera"} <= viewer.nodes.keys()
        # The board of the first pose has its first corner on the axis, one square inside its rim.
        np.testing.assert_allclose(viewer.nodes["/boards/00"].position, [32.0, 20.0, 0.0], atol=1e-6)
        # Where a scan is taken they would be in its way.
        view.begin(["left", "right"])
        wait_until(lambda: "/boards/00" not in viewer.nodes)


def test_each_laser_sheet_holds_the_points_that_its_laser_lights(view: CloudView) -> None:
    rig = standard_rig(640, 480).rig
    view.show_rig(rig)
    with served(view) as port, watch(port) as viewer:
        wait_until(lambda: "/lasers/1" in viewer.nodes and "/camera" in viewer.nodes)
        for number, plane in enumerate(rig.lasers.values()):
            corners = viewer.nodes[f"/lasers/{number}"].props["vertices"].reshape(-1, 3).astype(float)
            assert len(corners) >= 4
            in_camera = rig.axis.camera_from_table @ corners
            assert np.abs(plane.signed_distance(in_camera)).max() < 1e-3
        eye = rig.axis.camera_from_table.inverse().translation
        np.testing.assert_allclose(viewer.nodes["/camera"].position, eye, atol=1e-4)


def test_the_table_stands_where_it_was_told_last(view: CloudView) -> None:
    with served(view) as port, watch(port) as viewer:
        for angle in np.linspace(0.0, np.pi / 2.0, 500):
            view.turn_to(float(angle))
        wait_until(lambda: "/table" in viewer.nodes)
        expected = (np.cos(np.pi / 4.0), 0.0, 0.0, np.sin(np.pi / 4.0))
        wait_until(lambda: np.allclose(viewer.nodes["/table"].wxyz, expected))


def test_pictures_are_asked_for_only_while_somebody_watches(view: CloudView) -> None:
    asked: list[int] = []

    def newest() -> np.ndarray:
        asked.append(1)
        return np.full((720, 1280), 90, np.uint8)

    view.show_rig(standard_rig(640, 480).rig)
    view.show_pictures(newest)
    assert view.settle()
    assert view.settle()
    assert asked == []
    with served(view) as port, watch(port) as viewer:
        viewer.look()
        wait_until(lambda: len(asked) > 1)
        wait_until(lambda: viewer.nodes["/camera"].props.get("_image_data") is not None)
        assert len(viewer.nodes["/camera"].props["_image_data"]) < 20_000
    view.show_pictures(None)


def test_points_change_colour_and_size_for_everybody(view: CloudView) -> None:
    view.begin(("left", "right"))
    view.add(profile(0, "left"))
    view.add(profile(1, "right"))
    with served(view) as port, watch(port) as viewer:
        name = "/table/scan/live/00"
        wait_until(lambda: name in viewer.nodes)
        by_mode: dict[ColourMode, NDArray[np.uint8]] = {}
        for mode in ("texture", "laser", "quality", "angle", "height"):
            before = viewer.nodes[name]
            view.colour_by(mode)
            wait_until(lambda before=before: viewer.nodes[name] is not before)  # type: ignore[misc]
            by_mode[mode] = viewer.nodes[name].props["colors"]
        assert len({colours.tobytes() for colours in by_mode.values()}) == 5
        assert (by_mode["texture"].reshape(-1, 3) == [200, 150, 90]).all()
        view.set_point_size(2.5)
        wait_until(lambda: viewer.nodes[name].props["point_size"] == 2.5)
    with pytest.raises(OptionError):
        view.colour_by("taste")
    with pytest.raises(OptionError):
        view.set_point_size(0.0)


def test_clouds_and_meshes_take_each_others_place(view: CloudView) -> None:
    with served(view) as port, watch(port) as viewer:
        view.show_cloud(profile(3).cloud)
        wait_until(lambda: len(viewer.points()) == 700)
        np.testing.assert_allclose(viewer.points(), profile(3).cloud.points, atol=1e-4)
        vertices = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 5.0]])
        view.show_mesh(vertices, np.array([[0, 1, 2]]))
        wait_until(lambda: "/table/mesh" in viewer.nodes and not viewer.clouds())
        plain = viewer.nodes["/table/mesh"]
        view.show_mesh(vertices, np.array([[0, 1, 2]]), np.full((3, 3), 90, np.uint8))
        wait_until(lambda: viewer.nodes.get("/table/mesh", plain) is not plain)
        view.clear()
        wait_until(lambda: "/table/mesh" not in viewer.nodes)
        assert not view.problem


def test_one_page_is_moved_and_the_other_stays(view: CloudView) -> None:
    with served(view) as port, watch(port, "/view/mine") as mine, watch(port, "/view/other") as other:
        mine.look()
        other.look()
        wait_until(lambda: view.viewers == 2)
        view.look("top", tab="mine")
        wait_until(lambda: mine.others.get("SetCameraPositionMessage", {}).get("initial") is False)
        assert other.others["SetCameraPositionMessage"]["initial"] is True
        view.look("left")
        wait_until(lambda: other.others["SetCameraPositionMessage"]["initial"] is False)
        with pytest.raises(OptionError):
            view.look("camera")


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_has_the_object_before_the_eyes(preset: str) -> None:
    rig = standard_rig(640, 480).rig
    world_from_camera = rig.axis.camera_from_table.inverse()
    eye, target = place(preset, 100.0, 150.0, world_from_camera)
    middle = np.array([0.0, 0.0, 40.0])
    forward, towards = unit(target - eye), unit(middle - eye)
    assert 100.0 < np.linalg.norm(middle - eye) < 1000.0
    assert np.degrees(np.arccos(forward @ towards)) < np.degrees(FOV_RAD) / 2.0
    with pytest.raises(OptionError):
        place("inside", 100.0, 150.0, None)


def test_what_cannot_be_drawn_is_told_and_the_next_thing_is_drawn() -> None:
    with CloudView() as view, served(view) as port, watch(port) as viewer:
        view.show_mesh(np.zeros((3, 2)), np.zeros((1, 3), np.int64))
        view.show_cloud(profile(0).cloud)
        wait_until(lambda: len(viewer.points()) == 700)
        assert view.problem
