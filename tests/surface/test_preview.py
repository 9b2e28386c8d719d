from pathlib import Path

import cv2
import numpy as np
import pytest
from clouds import some_cloud

from app.errors import OutputError
from app.geometry.cloud import PointCloud
from app.surface.preview import PreviewPainter
from app.surface.splat import PAPER, View, splatted

FRONT = View("front", np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), ("y", "z"))


def coloured(points: list[list[float]], colours: list[list[int]]) -> PointCloud:
    n = len(points)
    scalars = np.ones(n, np.float32)
    return PointCloud(
        np.array(points, np.float32), np.zeros((n, 3), np.float32), np.array(colours, np.uint8), scalars,
        np.zeros(n, np.uint8), scalars, scalars,
    )  # fmt: skip


def test_the_nearer_point_hides_the_one_behind_it() -> None:
    for order in ([0, 1], [1, 0]):
        cloud = coloured([[10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]], [[255, 0, 0], [0, 0, 255]])
        picture = splatted(cloud.select(np.array(order)), FRONT, np.zeros(3), 1.0, (41, 41))
        blue, _, red = picture[20, 20].astype(int)
        assert red > 150
        assert blue < 20


def test_a_point_lands_where_its_coordinates_say() -> None:
    cloud = coloured([[0.0, 10.0, 5.0]], [[255, 255, 255]])
    picture = splatted(cloud, FRONT, np.zeros(3), 0.5, (100, 100))
    drawn = np.argwhere(np.any(picture != PAPER, axis=2))
    assert np.abs(drawn.mean(axis=0) - [40.0, 70.0]).max() <= 1.0


def test_the_picture_shows_three_sides(tmp_path: Path) -> None:
    painter = PreviewPainter()
    painter.add(some_cloud(5000))
    painter.write(tmp_path / "preview.png")
    picture = cv2.imread(str(tmp_path / "preview.png"))
    assert picture is not None
    height, width = picture.shape[:2]
    assert width > 2.5 * height
    for panel in np.array_split(picture, 3, axis=1):
        assert np.mean(np.any(panel != PAPER, axis=2)) > 0.05


def test_a_long_stream_is_thinned_evenly_and_counted_wholly() -> None:
    painter = PreviewPainter(limit=1000)
    whole = some_cloud(20_000)
    for start in range(0, 20_000, 37):
        painter.add(whole.select(np.arange(start, min(start + 37, 20_000))))
    kept = PointCloud.joined(painter._kept)
    assert 400 <= len(kept) <= 1000
    np.testing.assert_array_equal(kept.points, whole.points[:: 20_000 // len(kept)])


def test_an_empty_cloud_has_an_empty_picture() -> None:
    assert PreviewPainter().image().shape[2] == 3


def test_a_single_point_can_be_painted() -> None:
    painter = PreviewPainter()
    painter.add(some_cloud(1))
    assert np.any(painter.image() != PAPER)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        PreviewPainter().write(tmp_path / "nowhere" / "preview.png")
