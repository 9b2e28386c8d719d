"""How many pictures are made, and what one costs."""

import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

from app.live.settings import Kind

_WINDOW_S = 2.0
_MOST = 240


@dataclass(frozen=True, slots=True)
class LiveState:
    """How it goes, for those who watch over the server.

    Attributes:
        viewers: how many look, by kind.
        fps: pictures made per second lately, by kind.
        ms: what one of them took of a processor lately, milliseconds, by kind; what a frame is computed once
            for is part of the first kind that needed it.
        made: pictures since the start.
        made_of: the same by kind.
        skipped: frames that present viewers were not shown.
        is_running: whether threads are at work.
        problem: why no pictures come; empty while they do.
    """

    viewers: Mapping[Kind, int]
    fps: Mapping[Kind, float]
    ms: Mapping[Kind, float]
    made: int
    made_of: Mapping[Kind, int]
    skipped: int
    is_running: bool
    problem: str


class Meter:
    """Counts; one thread adds, any may read."""

    def __init__(self) -> None:
        self.made_of: Counter[Kind] = Counter()
        self._lately: dict[Kind, deque[tuple[float, float]]] = {kind: deque(maxlen=_MOST) for kind in Kind}

    def add(self, kind: Kind, took_s: float) -> None:
        self.made_of[kind] += 1
        self._lately[kind].append((time.monotonic(), took_s))

    def fps(self) -> dict[Kind, float]:
        return {kind: len(self._costs(kind)) / _WINDOW_S for kind in Kind}

    def ms(self) -> dict[Kind, float]:
        costs = {kind: self._costs(kind) for kind in Kind}
        return {kind: 1e3 * sum(each) / len(each) if each else 0.0 for kind, each in costs.items()}

    def _costs(self, kind: Kind) -> list[float]:
        since_s = time.monotonic() - _WINDOW_S
        return [took_s for at_s, took_s in tuple(self._lately[kind]) if at_s >= since_s]
