"""FabScanPi boards: HAT, Ciclop board and CNC shield with the FabScanPi firmware, in all its versions."""

import contextlib
import math
import re
import time
from dataclasses import dataclass

from app.devices.bearings import Bearings
from app.devices.board_driver import BoardDriver
from app.devices.fabscan_dialogue import BAUDS, FabScanDialogue
from app.devices.fabscan_words import (
    FASTEST,
    LASERS,
    MOST_COUNTS,
    counts_per_s,
    is_trap,
    move_command,
    turn_commands,
    usual_counts_per_step,
)
from app.devices.overtaking import overtaking
from app.devices.refusals import check_laser, check_speed
from app.devices.serial_link import SerialLink
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


class FabScan(BoardDriver):
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
        bauds = (baud,) if baud else BAUDS
        super().__init__(SerialLink(port, bauds[0], name), Bearings(name, steps_per_turn / 360.0))
        self.speed = speed
        self._asked_counts = counts_per_step
        self._counts_per_step = counts_per_step or 4
        self._board = FabScanDialogue(self._link, bauds)
        self._turn: _Turn | None = None
        self._stops = 0

    @property
    def facts(self) -> TurntableFacts:
        step_deg = 1.0 / self._bearings.per_deg
        kind = f" ({self._board.board})" if self._board.board else ""
        return TurntableFacts(
            f"FabScanPi {self._board.version}{kind}".strip(),
            self.port,
            tuple(range(len(LASERS))),
            step_deg,
            slowest_deg_s=step_deg / self._counts_per_step,
            fastest_deg_s=FASTEST * step_deg / self._counts_per_step,
        )

    @property
    def farewell(self) -> Farewell | None:
        # For a board that opening does not reset, and again for one that it does.
        off = b"M22;\nM20;\nM18;\n"
        return Farewell(self.port, self._link.baud, ((b"\n" + off, 1.5), (off, 0.3)))

    def connect(self) -> None:
        if not (self.is_connected and self._still_answers()):
            self._reopen()
        try:
            with self._link.dialogue():
                self._darken()
        except DeviceError:
            self._link.close()
            raise
        self._bearings.require_known()

    def move_to(self, angle_deg: float) -> float:
        with self._dialogue():
            began = self._stops
            self._bearings.require_known()
            target = self._bearings.nearest(angle_deg)
            self._prepare(self._steps_to(target))
            # Never F0, which hangs the board.
            feed = max(1, self._feed(min(self.speed, self.facts.fastest_deg_s)))
            piece = max(1, min(int(_PIECE_S * feed), MOST_COUNTS) // self._counts_per_step)
            while left := self._steps_to(target):
                self._move(max(-piece, min(piece, left)), feed)
                if self._stops != began:
                    raise MoveStopped(self.name, f"the move to {angle_deg:g} degrees was stopped")
            return self.angle_deg

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        check_speed(self.name, speed_deg_s, self.facts.slowest_deg_s, self.facts.fastest_deg_s)
        feed = min(self._feed(speed_deg_s), FASTEST)
        with self._dialogue():
            self._bearings.require_known()
            target = self._bearings.nearest(self.angle_deg + angle_deg)
            longest = _MOST_PARTS * (MOST_COUNTS // self._counts_per_step)
            if abs(self._steps_to(target)) >= longest:
                most = longest / self._bearings.per_deg
                raise DeviceRefused(self.name, f"turns steadily by {most:.0f} degrees at most")
            self._prepare(self._steps_to(target))
            from_deg, left = self.angle_deg, self._steps_to(target)
            commands = turn_commands(left, self._counts_per_step, feed)
            duration_s = abs(left) * self._counts_per_step / counts_per_s(feed)
            if commands:
                self._bearings.set_out(target)
                self._turn = _Turn(commands, target, time.monotonic() + 1.1 * duration_s + _SLACK_S)
                self._send_turn(commands)
            # It begins as soon as it has echoed the line.
            started_s = time.monotonic()
            speed = math.copysign(counts_per_s(feed), left) / self._counts_per_step / self._bearings.per_deg
            return SteadyTurn(from_deg, self._bearings.degrees(target), speed, started_s, 0.0, duration_s)

    def finish_turning(self) -> float:
        with self._dialogue():
            self._bearings.require_known()
            return self.angle_deg

    def stop(self) -> float:
        self._stops += 1
        if self._turn is not None:
            with overtaking(self._link):
                if self._turn is not None:
                    self._reopen()
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
            self._bearings.require_known()
            return self.angle_deg

    def set_laser(self, channel: int, is_on: bool) -> None:
        hint = "Its lasers are 0, the right one, and 1, the left one."
        check_laser(self.name, channel, self.facts.laser_channels, hint)
        with self._dialogue():
            self._board.switch(*LASERS[channel], is_on=is_on)

    def hold(self, is_holding: bool) -> None:
        with self._dialogue():
            self._board.request("M17" if is_holding else "M18")

    def make_safe(self) -> None:
        with contextlib.suppress(PositionUnknown):
            self.stop()
        with self._link.dialogue():
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
                self._bearings.set_out(self._bearings.at + round(int(found[1]) / self._counts_per_step))
                self._bearings.lose()
            self._board.send(command)
            return self._board.await_prompt(command, 60.0).strip()

    def _still_answers(self) -> bool:
        """Whether the connected board answers, when it has come to the end of what it does."""
        with self._link.dialogue(wait_s=_BUSY_WAIT_S):
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
        self._bearings.lose()
        self._board.open(left_s)
        self._counts_per_step = self._asked_counts or usual_counts_per_step(self._board.version)

    def _dialogue(self) -> contextlib.ExitStack:
        """Nobody else talks, and the table stands."""
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._link.dialogue(wait_s=_BUSY_WAIT_S))
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
        command, goal = move_command(counts, feed), self._bearings.at + steps
        self._link.discard()
        self._board.write(command)
        self._bearings.set_out(goal)
        timeout_s = 1.1 * abs(counts) / feed + _SLACK_S
        try:
            self._board.await_echo(command, timeout_s)
            self._board.await_prompt(command, timeout_s)
        except DeviceTimeout as error:
            raise self._bearings.lost() from error
        self._bearings.arrive(goal)

    def _send_turn(self, commands: tuple[str, ...]) -> None:
        try:
            self._board.send(commands[0])
            for command in commands[1:]:
                self._board.write(command)
        except DeviceTimeout as error:
            self._turn = None
            raise self._bearings.lost() from error

    def _finish_turn(self) -> None:
        """Wait for the end of a steady turn, if there is one; a move that nobody waits for is lost."""
        turn = self._turn
        if turn is None:
            self._bearings.lose()
            return
        try:
            for number, command in enumerate(turn.commands):
                left_s = max(0.0, turn.ends_s - time.monotonic())
                if number:
                    self._board.await_echo(command, left_s)
                self._board.await_prompt(command, left_s)
        except MoveStopped as error:
            raise self._bearings.lost() from error
        except DeviceTimeout as error:
            self._turn = None
            raise self._bearings.lost() from error
        except DeviceLost:
            self._turn = None
            raise
        self._bearings.arrive(turn.target)
        self._turn = None

    def _darken(self) -> None:
        for _, off in LASERS:
            self._board.request(off)

    def _steps_to(self, target: int) -> int:
        return round(target - self._bearings.at)

    def _feed(self, speed_deg_s: float) -> int:
        """Counts per second, of which the firmware takes whole ones."""
        return round(abs(speed_deg_s) * self._counts_per_step * self._bearings.per_deg)


TURNTABLES.register("fabscan", FabScan)
