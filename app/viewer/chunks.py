"""The growing cloud as a bounded number of bounded nodes, each of which is sent once or a few times.

New points become a small node. Many small nodes become a block, and equal blocks become a larger one, as
in a log-structured merge tree; what was merged goes one tick later, because a gap is seen and points drawn
twice are not. Points that the eye cannot tell apart are left out of blocks, more of them when the
display has too many. Names are used again, since viser remembers every name it has heard.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from app.viewer.display import DisplayPoints

LIVE_NODES = 64
BLOCK_POINTS = 350_000
BUDGET_POINTS = 1_500_000
_BLOCKS_ALIKE = 6
# How full the display may be after points were left out, so that this is rarely needed.
_LEFT_AFTER_COARSENING = 0.6


class CloudNodes(Protocol):
    """Where nodes are drawn."""

    def draw(self, name: str, shown: DisplayPoints, cell_mm: float, *, is_exact: bool) -> None:
        """Draw points under a new name, or instead of those that had it.

        Args:
            name: below the node of the cloud, such as `live/07`.
            shown: the points.
            cell_mm: their least distance in a block.
            is_exact: whether every bit of the coordinates matters.
        """

    def erase(self, name: str) -> None: ...


@dataclass(frozen=True, eq=False, slots=True)
class _Node:
    name: str
    shown: DisplayPoints
    rank: int = 0
    is_exact: bool = False

    @property
    def is_full(self) -> bool:
        return len(self.shown) >= BLOCK_POINTS // 2


class CloudChunks:
    """Keeps what is shown of a cloud; used by one thread.

    Args:
        nodes: where it is drawn.
        budget: most points that are shown.
        cell_mm: points nearer to each other than this look like one.
    """

    def __init__(self, nodes: CloudNodes, budget: int = BUDGET_POINTS, cell_mm: float = 0.1) -> None:
        self._nodes, self._budget, self._finest_mm = nodes, budget, cell_mm
        self.cell_mm = cell_mm
        self._live: list[_Node] = []
        self._blocks: list[_Node] = []
        self._leaving: list[_Node] = []

    def __len__(self) -> int:
        """Points that are shown."""
        return sum(len(node.shown) for node in (*self._live, *self._blocks))

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes that are drawn, those that are about to go as well."""
        return tuple(node.name for node in (*self._live, *self._blocks, *self._leaving))

    @property
    def has_leaving(self) -> bool:
        return bool(self._leaving)

    def grow(self, shown: DisplayPoints) -> None:
        """Show more points, and take away what an earlier call has merged."""
        self.sweep()
        for part in shown.parts(BLOCK_POINTS):
            self._live.append(self._drawn("live", part))
        if len(self._live) >= LIVE_NODES or sum(len(n.shown) for n in self._live) >= BLOCK_POINTS:
            self._merge_live()
        if len(self) > self._budget:
            self._coarsen()

    def sweep(self) -> None:
        """Take away what was merged before."""
        for node in self._leaving:
            self._nodes.erase(node.name)
        self._leaving.clear()

    def settle(self) -> None:
        """Show all points once more, exactly, in as few nodes as possible."""
        self._rebuild(self.all_points().thinned(self.cell_mm), is_exact=True)

    def replace(self, shown: DisplayPoints) -> None:
        """Show these points instead, exactly, and no more of them than the budget."""
        self.clear()
        while len(shown) > self._budget:
            thin = shown.thinned(self.cell_mm)
            if len(thin) > self._budget:
                self.cell_mm *= 2.0
            shown = thin
        self._rebuild(shown, is_exact=True)

    def repaint(self) -> None:
        """Draw every node again: what its points look like has changed."""
        for node in (*self._live, *self._blocks):
            self._nodes.draw(node.name, node.shown, self.cell_mm, is_exact=node.is_exact)

    def clear(self) -> None:
        self._leaving += [*self._live, *self._blocks]
        self._live, self._blocks = [], []
        self.cell_mm = self._finest_mm
        self.sweep()

    def all_points(self) -> DisplayPoints:
        """Everything that is shown."""
        return DisplayPoints.joined([node.shown for node in (*self._blocks, *self._live)])

    def _merge_live(self) -> None:
        merged = DisplayPoints.joined([node.shown for node in self._live]).thinned(self.cell_mm)
        self._leaving += self._live
        self._live = []
        self._add_blocks(merged, rank=0)
        by_rank: defaultdict[int, list[_Node]] = defaultdict(list)
        for node in self._blocks:
            if not node.is_full:
                by_rank[node.rank].append(node)
        for rank in sorted(by_rank):
            alike = by_rank[rank]
            if len(alike) < _BLOCKS_ALIKE:
                continue
            self._blocks = [node for node in self._blocks if node not in alike]
            self._leaving += alike
            merged = DisplayPoints.joined([node.shown for node in alike]).thinned(self.cell_mm)
            by_rank[rank + 1] += [node for node in self._add_blocks(merged, rank + 1) if not node.is_full]

    def _coarsen(self) -> None:
        everything = self.all_points()
        while len(everything) > _LEFT_AFTER_COARSENING * self._budget:
            self.cell_mm *= 2.0
            everything = everything.thinned(self.cell_mm)
        self._rebuild(everything, is_exact=False)

    def _rebuild(self, shown: DisplayPoints, *, is_exact: bool) -> None:
        self._leaving += [*self._live, *self._blocks]
        self._live, self._blocks = [], []
        self._add_blocks(shown, rank=0, is_exact=is_exact)

    def _add_blocks(self, shown: DisplayPoints, rank: int, *, is_exact: bool = False) -> list[_Node]:
        added = []
        for part in shown.parts(BLOCK_POINTS):
            node = self._drawn("block", part, rank, is_exact=is_exact)
            self._blocks.append(node)
            added.append(node)
        return added

    def _drawn(self, kind: str, shown: DisplayPoints, rank: int = 0, *, is_exact: bool = False) -> _Node:
        name = _first_free(lambda number: f"{kind}/{number:02d}", self.names)
        self._nodes.draw(name, shown, self.cell_mm, is_exact=is_exact)
        return _Node(name, shown, rank, is_exact)


def _first_free(name: Callable[[int], str], taken: Iterable[str]) -> str:
    known = set(taken)
    number = 0
    while name(number) in known:
        number += 1
    return name(number)
