"""The one world that the simulated camera and the simulated board share."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np

from app.errors import OptionError
from app.geometry.rig import Rig
from app.simulation.clock import Clock
from app.simulation.exposure import SensorSettings
from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort
from app.simulation.hands import Hands
from app.simulation.history import History
from app.simulation.rig import SimulatedRig
from app.simulation.stage import Moment, Stage, Thing
from app.simulation.world_plan import WorldPlan

__all__ = ["SimulatedWorld", "WorldPlan"]

# The machine is remembered for ten seconds.
_REMEMBERED_S = 9.0


class SimulatedWorld:
    """Board, machine, scene and light, in one time. Safe from several threads.

    Attributes:
        plan: what it was made from.
        clock: its time.
        plant: motor, table and laser outputs.
        port: the board behind its pseudo-terminal; connect to `port.link`. Its faults are on demand.
        stage: what can be seen: object, board, true rig.
    """

    def __init__(self, plan: WorldPlan, folder: Path) -> None:
        """Build it; the port appears in `folder`.

        Raises:
            OptionError: no such dialect or object, or a board that does not fit.
        """
        self.plan = plan
        self.stage = Stage(plan)
        self.clock = Clock(plan.rate)
        maker = FIRMWARES.maker(plan.dialect)
        self.plant = Plant(_wiring(plan, maker, tuple(self.stage.scanner.rig.lasers)))
        self.port = EmulatedPort(
            maker(plant=self.plant), folder / plan.dialect, self.clock,
            resets_on_open=plan.resets_on_open, seed=plan.seed,
        )  # fmt: skip
        self._arranged = History(_Arrangement("object"), 2.0 * _REMEMBERED_S)
        self._endings: list[Callable[[], None]] = []
        self._is_closed, self._closing = False, threading.Lock()

    @property
    def scanner(self) -> SimulatedRig:
        """The true scanner."""
        return self.stage.scanner

    @property
    def rig(self) -> Rig:
        """What a perfect calibration would find."""
        return self.scanner.rig

    @property
    def light(self) -> float:
        """How bright the room is; 1 as usual, 0 in the dark."""
        return self._arranged.last.room

    @light.setter
    def light(self, room: float) -> None:
        if not (np.isfinite(room) and room >= 0.0):
            raise OptionError(f"A room cannot have a brightness of {room:g}.", "Give 0 or more.")
        self._change(room=room)

    @property
    def standing(self) -> tuple[Thing, int]:
        """What is before the camera, and the number of the place where a board stands on the table."""
        now = self._arranged.last
        return now.thing, now.placement

    def put(self, what: Literal["object", "object-lying", "nothing", "board-on-table"]) -> None:
        """Change what stands on the table; hands that hold the board go away."""
        if what not in ("object", "object-lying", "nothing", "board-on-table"):
            raise OptionError(
                f"Nobody can put {what!r} on the table.",
                "Put: object, object-lying, nothing or board-on-table.",
            )
        self._change(thing=what, placement=0, hands=None)

    def place_board(self, number: int) -> None:
        """Stand the board on the table, at another place for each number."""
        self._change(thing="board-on-table", placement=number, hands=None)

    def hold_board(self, *, across_lasers: bool = False) -> None:
        """A pair of hands holds the board, in another pose every second or so, and takes the table away.

        Args:
            across_lasers: where every laser's sheet crosses it, instead of all over the picture.
        """
        hands = Hands.of(self.rig, self.stage.board, across_lasers=across_lasers, seed=self.plan.seed)
        self._change(thing="board-in-hands", hands=hands, held_since_s=self.clock.now_s())

    def moment(self, start_s: float, settings: SensorSettings) -> Moment:
        """What the world was like while a picture was exposed.

        Args:
            start_s: when the exposure began, world time. Best called when it has ended, and not later than
                some seconds after.
            settings: of the camera.
        """
        start_s = max(start_s, self.clock.now_s() - _REMEMBERED_S)
        end_s = start_s + 1e-6 * settings.exposure_us
        middle_s = 0.5 * (start_s + end_s)
        now = self._arranged.at(middle_s)
        names = self.plant.wiring.lasers
        shares = self.plant.shares_on(start_s, end_s)
        return Moment(
            now.thing, now.placement,
            None if now.hands is None else now.hands.pose_at(middle_s - now.held_since_s),
            float(np.radians(self.plant.at(middle_s).angle_deg % 360.0)),
            now.room,
            {names[output]: share for output, share in shares.items() if output in names},
            hash((self.plan.seed, round(1e6 * start_s))) % 2**63,
        )  # fmt: skip

    def at_close(self, end: Callable[[], None]) -> None:
        """Have something that belongs to this world end with it; at once, where it has ended."""
        with self._closing:
            if not self._is_closed:
                self._endings.append(end)
                return
        end()

    def close(self) -> None:
        """Take the port away."""
        self.port.close()
        with self._closing:
            self._is_closed = True
        while self._endings:
            self._endings.pop()()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _change(self, **changed: object) -> None:
        arranged = replace(self._arranged.last, **changed)  # type: ignore[arg-type]
        self._arranged.change(arranged, self.clock.now_s())


@dataclass(frozen=True, eq=False, slots=True)
class _Arrangement:
    """What somebody has put there."""

    thing: Thing
    placement: int = 0
    hands: Hands | None = None
    held_since_s: float = 0.0
    room: float = 1.0


def _wiring(plan: WorldPlan, maker: Callable[..., Firmware], lasers: tuple[str, ...]) -> Wiring:
    """The mechanics as the dialect expects them, but for the planted faults."""
    outputs: tuple[int, ...] = getattr(maker, "outputs", Firmware.outputs)
    steps_per_turn = plan.steps_per_turn or float(getattr(maker, "steps_per_turn", Firmware.steps_per_turn))
    names = lasers[::-1] if plan.swapped_lasers else lasers
    return Wiring(
        -steps_per_turn if plan.wrong_direction else steps_per_turn,
        plan.play_deg,
        dict(zip(outputs, names, strict=False)),
    )
