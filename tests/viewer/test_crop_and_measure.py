"""A part of the cloud alone, and distances in it, as a viewer sees them through our own server."""

from collections.abc import Iterator

import numpy as np
import pytest
from served_view import profile, served, wait_until, watch

from app.errors import OptionError
from app.geometry.cloud import PointCloud
from app.viewer.cloud_view import CloudView


@pytest.fixture
def view() -> Iterator[CloudView]:
    with CloudView() as view:
        yield view
        assert view.problem == ""


def test_a_part_of_the_cloud_is_shown_alone_and_the_whole_again(view: CloudView) -> None:
    with served(view) as port, watch(port) as viewer:
        view.begin(("left", "right"))
        for number in range(10):
            view.add(profile(number))
        view.finish()
        assert view.settle()
        wait_until(lambda: len(viewer.clouds()) == 1)
        whole = len(viewer.points())
        view.crop((-500.0, -500.0, 20.0), (500.0, 500.0, 40.0))
        wait_until(lambda: 0 < len(viewer.points()) < whole)
        heights = viewer.points()[:, 2]
        assert heights.min() > 19.99
        assert heights.max() < 40.01
        assert "/table/crop" in viewer.nodes
        view.crop((-500.0, -500.0, 900.0), (500.0, 500.0, 901.0))
        wait_until(lambda: len(viewer.points()) == 0)
        view.crop(None, None)
        wait_until(lambda: len(viewer.points()) == whole and "/table/crop" not in viewer.nodes)
        with pytest.raises(OptionError):
            view.crop((0.0, 0.0, 5.0), (1.0, 1.0, 5.0))


def test_a_distance_is_measured_between_two_points_that_one_page_sees(view: CloudView) -> None:
    corners = np.array([[0, -30, 40], [0, 30, 40], [-5, 0, 40], [80, 0, 40], [0, -30, 5]], np.float32)
    with served(view) as port, watch(port, "/view/page") as viewer:
        view.show_cloud(_cloud_of(corners))
        # The table has turned: what is measured stands on it, the eye does not.
        view.turn_to(np.pi / 2.0)
        assert view.settle()
        # Straight down from 440 mm, the picture's right along the world's x.
        viewer.look(wxyz=(0.0, 1.0, 0.0, 0.0), position=(0.0, 0.0, 440.0))
        wait_until(lambda: view.viewers == 1)
        half = 400.0 * np.tan(0.35)
        aside = 30.0 / (half * 800.0 / 600.0) / 2.0
        (first,) = view.measure_at("page", 0.5 + aside, 0.5)
        np.testing.assert_allclose(first, corners[0])
        assert view.measure_at("page", 0.5 - aside, 0.502) == (first, tuple(corners[1].tolist()))
        wait_until(lambda: "/table/measure/number" in viewer.nodes)
        # Its strokes lie side by side along the view's right, in the middle between the points.
        number = viewer.nodes["/table/measure/number"].props["points"].reshape(-1, 3)
        assert np.ptp(number[:, 1]) > 3.0 * np.ptp(number[:, 0]) > 0.0
        np.testing.assert_allclose(number[:, 2], 40.0, atol=1e-3)
        # The same place, marked, and where the matrix of this view has it.
        picked = view.pick_at("page", 0.5 + aside, 0.5, [(0.0, 30.0, 40.0)])
        assert picked == tuple(corners[0].tolist())
        wait_until(lambda: "/table/marks/dots" in viewer.nodes)
        assert len(viewer.nodes["/table/marks/dots"].props["points"].reshape(-1, 3)) == 2
        x, y, _, ahead = view.view_matrix("page") @ [*picked, 1.0]
        assert ahead == pytest.approx(400.0)
        assert (x / ahead, y / ahead) == (pytest.approx(2.0 * aside), pytest.approx(0.0, abs=1e-9))
        view.forget_picks()
        wait_until(lambda: "/table/marks/dots" not in viewer.nodes)
        for place in ((0.99, 0.99), (0.5, 0.9)):
            with pytest.raises(OptionError):
                view.measure_at("page", *place)
        with pytest.raises(OptionError):
            view.measure_at("another", 0.5, 0.5)
        assert len(view.measure_at("page", 0.5 + aside, 0.5)) == 1
        wait_until(lambda: "/table/measure/number" not in viewer.nodes)
        view.forget_measure()
        wait_until(lambda: "/table/measure/ends" not in viewer.nodes)


def _cloud_of(points: np.ndarray) -> PointCloud:
    count = len(points)
    ones = np.ones(count, np.float32)
    return PointCloud(
        points, np.zeros_like(points), np.full((count, 3), 200, np.uint8), ones, np.zeros(count, np.uint8),
        ones, ones, ("left",),
    )  # fmt: skip
