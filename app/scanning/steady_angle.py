"""Where a table that turns steadily is at a time."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from app.devices.turntable import SteadyTurn, Turntable
from app.errors import DeviceError

_ASK_EVERY_S = 0.1
_ENOUGH = 5
# A board that answers later than this was kept from it, and says where the table was at no certain time.
_PROMPT_S = 0.03


class SteadyAngle:
    """Angle by time: from the turn as computed, put right by what the board says while the table runs in.

    Attributes:
        turn: as it was started.
        offset_deg: how far the board's own words are ahead of the computation.
    """

    def __init__(self, turn: SteadyTurn) -> None:
        self.turn = turn
        self.offset_deg = 0.0

    def at(self, time_s: float) -> float:
        """Degrees at a monotonic time, while the speed is constant."""
        since_s = time_s - self.turn.started_s - 0.5 * self.turn.steady_after_s
        return self.turn.from_deg + self.turn.speed_deg_s * since_s + self.offset_deg

    def is_steady(self, time_s: float) -> bool:
        return time_s >= self.turn.started_s + self.turn.steady_after_s


@contextmanager
def follow(table: Turntable, turn: SteadyTurn) -> Iterator[SteadyAngle]:
    """The angle of a turn under way. The board is asked where it is during the run-in only."""
    angle = SteadyAngle(turn)
    if not table.facts.tells_position or table.facts.turns_by_itself:
        yield angle
        return
    is_over = threading.Event()
    thread = threading.Thread(target=_listen, args=(table, angle, is_over), name="steady angle", daemon=True)
    thread.start()
    try:
        yield angle
    finally:
        is_over.set()
        thread.join()


def _listen(table: Turntable, angle: SteadyAngle, is_over: threading.Event) -> None:
    asked: list[tuple[float, float]] = []
    while len(asked) < _ENOUGH and not is_over.wait(_ASK_EVERY_S):
        asked_s = time.monotonic()
        if not angle.is_steady(asked_s):
            continue
        try:
            told_deg = table.position_now()
        except DeviceError:
            return
        answered_s = time.monotonic()
        if told_deg is not None and answered_s - asked_s < _PROMPT_S:
            computed = angle.at(0.5 * (asked_s + answered_s)) - angle.offset_deg
            asked.append((answered_s - asked_s, told_deg - computed))
            # The quickest answer is the least uncertain about when it was true.
            angle.offset_deg = min(asked)[1]
