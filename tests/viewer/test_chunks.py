"""The bookkeeping of nodes, without viser: nothing shown is lost, nothing grows without bound."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from served_view import profile

from app.geometry.cloud import PointCloud
from app.viewer.chunks import BLOCK_POINTS, LIVE_NODES, CloudChunks
from app.viewer.colouring import COLOUR_MODES, Colouring
from app.viewer.display import FULL_SHADE, DisplayPoints


class Recorded:
    """Nodes that are only written down.

    Attributes:
        drawn: what is drawn under each name.
        exact: the names of nodes that are drawn exactly.
        sent: points that were sent so far.
        names: every name there has been.
        most: nodes that were there at once.
    """

    def __init__(self) -> None:
        self.drawn: dict[str, DisplayPoints] = {}
        self.exact: set[str] = set()
        self.names: set[str] = set()
        self.sent = self.most = 0

    def draw(self, name: str, shown: DisplayPoints, cell_mm: float, *, is_exact: bool) -> None:
        self.drawn[name] = shown
        (self.exact.add if is_exact else self.exact.discard)(name)
        self.names.add(name)
        self.sent += len(shown)
        self.most = max(self.most, len(self.drawn))

    def erase(self, name: str) -> None:
        del self.drawn[name]
        self.exact.discard(name)

    def keys(self) -> set[bytes]:
        return {point.tobytes() for shown in self.drawn.values() for point in shown.points}


def spread(count: int, seed: int, size_mm: float = 200.0) -> DisplayPoints:
    """Points anywhere in a cube, hardly ever two in one cell."""
    points = np.random.default_rng(seed).uniform(0.0, size_mm, (count, 3)).astype(np.float32)
    one = np.zeros(count, np.uint8)
    return DisplayPoints(points, np.zeros((count, 3), np.uint8), one + FULL_SHADE, one, one, one)


def surface(count: int, seed: int) -> DisplayPoints:
    """Points on a square of 100 mm."""
    shown = spread(count, seed, 100.0)
    shown.points[:, 2] = 0.0
    return shown


def test_every_point_stays_in_sight_while_pieces_become_blocks() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes, cell_mm=1e-4)
    seen: set[bytes] = set()
    for number in range(5 * LIVE_NODES):
        new = spread(20, number)
        seen |= {point.tobytes() for point in new.points}
        chunks.grow(new)
        assert nodes.keys() == seen
        assert set(chunks.names) == nodes.drawn.keys()
    chunks.sweep()
    assert len(chunks) == sum(map(len, nodes.drawn.values())) == len(seen)


@given(sizes=st.lists(st.integers(0, 3000), max_size=30), seed=st.integers(0, 99))
def test_whatever_comes_the_display_keeps_its_budget(sizes: list[int], seed: int) -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes, budget=10_000)
    for number, size in enumerate(sizes):
        chunks.grow(spread(size, seed + number))
        assert len(chunks) <= 10_000
    chunks.sweep()
    assert sum(map(len, nodes.drawn.values())) == len(chunks)
    chunks.clear()
    assert nodes.drawn == {}


def test_nodes_and_names_are_few_however_long_the_scan() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes)
    for number in range(6000):
        chunks.grow(spread(3, number))
    chunks.sweep()
    assert nodes.most <= 2 * LIVE_NODES
    assert len(nodes.drawn) <= 100
    assert len(nodes.names) <= LIVE_NODES + 40


def test_what_was_merged_goes_one_tick_later() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes)
    for number in range(LIVE_NODES):
        chunks.grow(spread(5, number))
    assert len(nodes.drawn) == LIVE_NODES + 1
    chunks.grow(spread(5, 1000))
    assert sorted(nodes.drawn) == ["block/00", "live/00"]


def test_the_cost_of_a_point_does_not_grow_with_the_cloud() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes, budget=150_000)
    costs = []
    for million in range(5):
        before = nodes.sent
        for number in range(100):
            chunks.grow(surface(2000, 100 * million + number))
        costs.append((nodes.sent - before) / 200_000)
    assert max(costs) < 3.0
    assert costs[-1] <= costs[0] * 1.5


def test_a_finished_scan_is_drawn_exactly_in_few_nodes() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes)
    for number in range(100):
        chunks.grow(spread(10, number))
    everything = {point.tobytes() for point in chunks.all_points().points}
    chunks.settle()
    chunks.sweep()
    assert nodes.exact == nodes.drawn.keys() == {"block/00"} or len(nodes.drawn) == 1
    assert nodes.keys() == everything


def test_a_large_cloud_is_shown_within_the_budget_in_bounded_nodes() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes, budget=800_000)
    chunks.replace(surface(2_000_000, 1))
    assert 100_000 < len(chunks) <= 800_000
    assert all(len(shown) <= BLOCK_POINTS for shown in nodes.drawn.values())
    chunks.replace(surface(10, 1))
    assert len(chunks) == 10


def test_repainting_draws_the_same_points_again() -> None:
    nodes = Recorded()
    chunks = CloudChunks(nodes)
    chunks.grow(spread(50, 1))
    before = nodes.keys()
    chunks.repaint()
    assert (nodes.sent, nodes.keys()) == (100, before)


@given(cell=st.floats(0.05, 20.0), seed=st.integers(0, 99))
def test_thinning_keeps_one_point_of_every_cell(cell: float, seed: int) -> None:
    shown = spread(500, seed, 30.0)
    cells = {tuple(row) for row in np.floor(shown.points / cell).astype(int)}
    thin = shown.thinned(cell)
    assert len(thin) == len(cells)
    assert {tuple(row) for row in np.floor(thin.points / cell).astype(int)} == cells
    assert len(thin.thinned(cell)) == len(thin)


def test_points_keep_what_is_known_about_them() -> None:
    cloud = profile(90, "right", points=300).cloud
    shown = DisplayPoints.joined([DisplayPoints.of(cloud), DisplayPoints.of(PointCloud.empty())])
    assert (len(shown), set(shown.laser), set(shown.turn)) == (300, {1}, {64})
    assert shown.quality[0] == 51
    assert shown.quality[-1] == 255
    assert sum(map(len, shown.parts(7))) == 300
    assert max(map(len, shown.parts(7))) <= 7


def test_a_scan_without_texture_is_grey_and_not_black() -> None:
    cloud = profile(0).cloud
    cloud.colours[:] = 0
    colours = Colouring("texture").colours(DisplayPoints.of(cloud))
    assert (colours == colours[0, 0]).all()
    assert colours[0, 0] > 100


@pytest.mark.parametrize("mode", COLOUR_MODES)
def test_each_way_of_colouring_gives_one_colour_for_each_point(mode: str) -> None:
    shown = DisplayPoints.of(profile(10).cloud)
    colours = Colouring(mode, 80.0).colours(shown)  # type: ignore[arg-type]
    assert colours.shape == (700, 3)
    assert colours.dtype == np.uint8
    assert Colouring(mode).colours(DisplayPoints.of(PointCloud.empty())).shape == (0, 3)  # type: ignore[arg-type]


def test_a_higher_point_has_another_colour_and_a_surface_in_the_dark_is_darker() -> None:
    lit = DisplayPoints.of(profile(0).cloud)
    colours = Colouring("height", 80.0).colours(lit).astype(int)
    assert np.abs(colours[0] - colours[-1]).sum() > 100
    shown = DisplayPoints.of(profile(0).cloud)
    shown.shade[:] = FULL_SHADE // 4
    assert Colouring("height", 80.0).colours(shown).sum() < 0.5 * colours.sum()
