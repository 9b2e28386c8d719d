"""FabScanPi boards: HAT, Ciclop board and CNC shield with the FabScanPi firmware, in all its versions."""

import contextlib
import math
import re
import time
from dataclasses import dataclass

from app.devices.fabscan_dialogue import BOOT_S, FabScanDialogue
from app.devices.fabscan_words import (
    FASTEST,
    LASERS,
    MOST_COUNTS,
    counts_per_s,
    is_trap,
    move_command,
    usual_counts_per_step,
)
from app.devices.overtaking import overtaking
from app.devices.turntable import TURNTABLES, Farewell, SteadyTurn, TurntableFacts
from app.errors import (
    DeviceError,
    DeviceLost,
    DeviceRefused,
    DeviceTimeout,
    MoveStopped,
    OptionError,
    PositionUnknown,
)

# Lines for the parts of a turn that the board's 64 bytes can keep.
_MOST_PARTS = 3
_STEP_BACK_SPEED = 400
# Nothing reaches the board while it moves, so that a stop, and a laser that shall go out, wait for the end of
# a piece.
_PIECE_S = 0.5
_SLACK_S = 2.0
_BUSY_WAIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class _Turn:
    commands: tuple[str, ...]
    target: int
    ends_s: float


class FabScan:
    """A FabScanPi board: no word to stop, none to ask where it is, and nothing said when it resets itself.

    A move goes in pieces of half a second, and `stop` ends it after the piece under way, position known. A
    steady turn is one command: to stop it the port is opened anew, which resets the board, and where the
    table stands is unknown afterwards; so it is when the answer to a move is lost. Lasers are switched
    only while the table stands; `set_laser` waits for that.

    Moves use G01 with a speed, which has no ramp: G02 crawls for ever once the table has turned endlessly,
    and stops where nobody can tell. A move forwards begins with a step back, as the first step after a reset
    goes the wrong way unless it is one backwards. The light ring is never touched, as its green 6 turns the
    table and M04 puts the lasers out.

    Attributes:
        port: where the board is connected.
        name: what messages call it.
        baud: bits per second; 0 to try those of all versions.
        steps_per_turn: motor steps that turn the table once.
        counts_per_step: what the firmware's T counts of a step: 1, 2 or 4; 0 for what its version does.
        speed: of moves, degrees per second.
    """

    def __init__(
        self,
        port: str,
        name: str = "turntable",
        baud: int = 0,
        steps_per_turn: int = 3200,
        counts_per_step: int = 0,
        speed: float = 28.0,
    ) -> None:
        if steps_per_turn <= 0 or counts_per_step < 0 or baud < 0 or not speed > 0.0:
            raise OptionError(
                "A FabScanPi board needs positive steps_per_turn and speed, and no negative numbers.",
                "The usual ones are steps_per_turn = 3200 and speed = 28.",
            )
        self.port, self.name, self.speed = port, name, speed
        self._asked_counts = counts_per_step
        self._counts_per_step = counts_per_step or 4
        self._steps_per_turn = steps_per_turn
        self._board = FabScanDialogue(port, name, baud)
        self._facts = self._make_facts()
        self._steps, self._origin_deg = 0, 0.0
        self._underway: tuple[int, int] | None = None
        self._turn: _Turn | None = None
        self._stops = 0

    @property
    def facts(self) -> TurntableFacts:
        return self._facts

    @property
    def angle_deg(self) -> float:
        return self._degrees(self._steps)

    @property
    def farewell(self) -> Farewell | None:
        # Opening resets the board, or it does not; both are waited for.
        words = ((b"\n", 1.5), (b"M22;\nM20;\nM18;\n", 0.3))
        return Farewell(self.port, self._board.link.baud, words)

    @property
    def is_connected(self) -> bool:
        return self._board.link.is_open

    def connect(self) -> None:
        if not (self.is_connected and self._still_answers()):
            self._reopen()
        try:
            with self._board.link.dialogue():
                self._darken()
        except DeviceError:
            self._board.link.close()
            raise
        self._require_known()

    def disconnect(self) -> None:
        if self.is_connected:
            with contextlib.suppress(DeviceError):
                self.make_safe()
        self._board.link.close()

    def move_to(self, angle_deg: float) -> float:
        with self._dialogue():
            began = self._stops
            self._require_known()
            target = self._steps_at(angle_deg)
            self._prepare(target - self._steps)
            # Never F0, which hangs the board.
            feed = max(1, self._feed(min(self.speed, self._facts.fastest_deg_s)))
            piece = max(1, min(int(_PIECE_S * feed), MOST_COUNTS) // self._counts_per_step)
            while self._steps != target:
                self._move(max(-piece, min(piece, target - self._steps)), feed)
                if self._stops != began:
                    raise MoveStopped(self.name, f"the move to {angle_deg:g} degrees was stopped")
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        feed = self._feed(speed_deg_s)
        if not 1 <= feed <= FASTEST:
            low, high = self._facts.slowest_deg_s, self._facts.fastest_deg_s
            raise DeviceRefused(
                self.name,
                f"cannot turn at {speed_deg_s:g} degrees per second",
                f"Choose a speed from {low:.2g} to {high:.0f} degrees per second.",
            )
        with self._dialogue():
            self._require_known()
            target = self._steps_at(self.angle_deg + angle_deg)
            longest = MOST_COUNTS // self._counts_per_step
            if abs(target - self._steps) >= _MOST_PARTS * longest:
                most = _MOST_PARTS * longest * self._facts.smallest_deg
                raise DeviceRefused(self.name, f"turns steadily by {most:.0f} degrees at most")
            self._prepare(target - self._steps)
            way, left = (1 if target > self._steps else -1), abs(target - self._steps)
            commands = tuple(
                move_command(way * min(longest, left - done) * self._counts_per_step, feed)
                for done in range(0, left, longest)
            )
            duration_s = left * self._counts_per_step / counts_per_s(feed)
            from_deg = self.angle_deg
            if commands:
                self._underway = (self._steps, target)
                self._turn = _Turn(commands, target, time.monotonic() + 1.1 * duration_s + _SLACK_S)
                self._send_turn(commands)
            # It begins as soon as it has echoed the line.
            started_s = time.monotonic()
            speed = way * counts_per_s(feed) / self._counts_per_step * self._facts.smallest_deg
            return SteadyTurn(from_deg, self._degrees(target), speed, started_s, 0.0, duration_s)

    def finish_turning(self) -> float:
        with self._board.link.dialogue(wait_s=_BUSY_WAIT_S):
            self._finish_turn()
            self._require_known()
            return self.angle_deg

    def position_now(self) -> float | None:
        return None

    def stop(self) -> float:
        self._stops += 1
        if self._turn is not None:
            with overtaking(self._board.link):
                if self._turn is not None:
                    self._reopen()
        with self._board.link.dialogue(wait_s=_BUSY_WAIT_S):
            self._require_known()
            return self.angle_deg

    def zero(self, angle_deg: float = 0.0) -> None:
        self._origin_deg += angle_deg - self.angle_deg
        self._underway = None

    def set_laser(self, channel: int, is_on: bool) -> None:
        if channel not in self._facts.laser_channels:
            raise DeviceRefused(
                self.name, f"has no laser {channel}", "Its lasers are 0, the right one, and 1, the left one."
            )
        with self._dialogue():
            self._board.request(LASERS[channel][0 if is_on else 1])

    def hold(self, is_holding: bool) -> None:
        with self._dialogue():
            self._board.request("M17" if is_holding else "M18")

    def make_safe(self) -> None:
        with contextlib.suppress(PositionUnknown):
            self.stop()
        with self._board.link.dialogue():
            try:
                self._darken()
            except DeviceTimeout:
                # It hears nothing; a reset is the only way to put the lasers out.
                self._reopen()
                self._darken()
            self._board.request("M18")

    def talk(self, line: str) -> str:
        command = line.strip().rstrip(";")
        if is_trap(command):
            raise DeviceRefused(
                self.name,
                f"would hang or turn without end by {line!r}",
                "G01 needs a speed, as in `G01 T400 F800`; G06, and green 6 of the ring, are not sent.",
            )
        with self._dialogue():
            if found := re.search(r"\bG0?[0124]\b.*\bT(-?\d+)", command):
                # Nobody can tell what a number that is no multiple of a step does to the next move.
                steps = round(int(found[1]) / self._counts_per_step)
                self._underway = (self._steps, self._steps + steps)
            self._board.send(command)
            return self._board.await_prompt(command, 60.0).strip()

    def _still_answers(self) -> bool:
        """Whether the connected board answers, when it has come to the end of what it does."""
        with self._board.link.dialogue(wait_s=_BUSY_WAIT_S):
            try:
                self._finish_turn()
                self._board.request("M200")
            except DeviceTimeout:
                return False
            return True

    def _reopen(self) -> None:
        """Open the port, which resets the board; one that it does not reset ends its turn first."""
        left_s = 0.0 if self._turn is None else max(0.0, self._turn.ends_s - time.monotonic())
        self._turn = None
        self._board.open(BOOT_S + left_s)
        self._counts_per_step = self._asked_counts or usual_counts_per_step(self._board.version)
        self._facts = self._make_facts()

    def _dialogue(self) -> contextlib.ExitStack:
        """Nobody else talks, and the table stands."""
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._board.link.dialogue(wait_s=_BUSY_WAIT_S))
            self._finish_turn()
            return stack.pop_all()

    def _prepare(self, steps: int) -> None:
        """The board may have reset itself in silence: motor off, and the next step forwards a wrong one."""
        if steps:
            self._board.request("M17")
        if steps > 0:
            self._move(-1, _STEP_BACK_SPEED)

    def _move(self, steps: int, feed: int) -> None:
        """Turn at constant speed, and wait until the table stands."""
        counts = steps * self._counts_per_step
        command = move_command(counts, feed)
        was, self._underway = self._underway, (self._steps, self._steps + steps)
        try:
            self._board.link.discard()
            self._board.write(command)
        except DeviceLost:
            self._underway = was
            raise
        timeout_s = 1.1 * abs(counts) / feed + _SLACK_S
        try:
            self._board.await_echo(command, timeout_s)
            self._board.await_prompt(command, timeout_s)
        except DeviceTimeout as error:
            raise self._unknown(self._underway) from error
        self._steps, self._underway = self._underway[1], None

    def _send_turn(self, commands: tuple[str, ...]) -> None:
        try:
            self._board.send(commands[0])
            for command in commands[1:]:
                self._board.write(command)
        except DeviceTimeout as error:
            self._turn = None
            raise self._unknown(self._underway or (self._steps, self._steps)) from error

    def _finish_turn(self) -> None:
        """Wait for the end of a steady turn, if there is one."""
        turn = self._turn
        if turn is None:
            return
        try:
            for number, command in enumerate(turn.commands):
                left_s = max(0.0, turn.ends_s - time.monotonic())
                if number:
                    self._board.await_echo(command, left_s)
                self._board.await_prompt(command, left_s)
        except MoveStopped as error:
            raise self._unknown(self._underway or (self._steps, turn.target)) from error
        except DeviceTimeout as error:
            self._turn = None
            raise self._unknown(self._underway or (self._steps, turn.target)) from error
        except DeviceLost:
            self._turn = None
            raise
        self._steps, self._underway, self._turn = turn.target, None, None

    def _darken(self) -> None:
        for _, off in LASERS:
            self._board.request(off)

    def _require_known(self) -> None:
        if self._underway is not None:
            raise self._unknown(self._underway)

    def _unknown(self, ends: tuple[int, int]) -> PositionUnknown:
        return PositionUnknown(self.name, *sorted(map(self._degrees, ends)))

    def _degrees(self, steps: int) -> float:
        return self._origin_deg + steps * 360.0 / self._steps_per_turn

    def _steps_at(self, angle_deg: float) -> int:
        return round((angle_deg - self._origin_deg) * self._steps_per_turn / 360.0)

    def _feed(self, speed_deg_s: float) -> int:
        """Counts per second, of which the firmware takes whole ones."""
        if not math.isfinite(speed_deg_s):
            return 0
        return round(abs(speed_deg_s) * self._counts_per_step * self._steps_per_turn / 360.0)

    def _make_facts(self) -> TurntableFacts:
        step_deg = 360.0 / self._steps_per_turn
        kind = f" ({self._board.board})" if self._board.board else ""
        return TurntableFacts(
            f"FabScanPi {self._board.version}{kind}".strip(),
            self.port,
            tuple(range(len(LASERS))),
            step_deg,
            slowest_deg_s=step_deg / self._counts_per_step,
            fastest_deg_s=FASTEST * step_deg / self._counts_per_step,
        )


TURNTABLES.register("fabscan", FabScan)
