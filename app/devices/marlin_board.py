"""A Marlin board as a turntable wants it: set up after each of its starts, lasers as they were asked for."""

import contextlib
import time
from collections.abc import Callable

from app.devices.bearings import Bearings
from app.devices.laser_care import LASER_ANSWER_S, dark_unless_answered
from app.devices.marlin_dialogue import MarlinDialogue, MarlinPosition, MarlinRestarted
from app.devices.marlin_words import LaserWords, setup_words, steps_per_unit
from app.devices.refusals import resets_again
from app.devices.serial_link import SerialLink
from app.errors import DeviceError, DeviceTimeout, MoveStopped, PositionUnknown

FASTEST_DEG_S = 360.0
_CLOSED_S = 0.1
_STARTS = 3


class MarlinBoard:
    """What a board forgets when it resets itself, and how it is told again.

    Attributes:
        link: the port.
        dialogue: request and answer.
        bearings: where the table stands; the board counts steps of `axis`.
        axis: `X` or `E`.
        acceleration: degrees per second squared.
        channels: pins or fans that switch lasers.
        lit: those of them that shall be on.
    """

    def __init__(
        self,
        link: SerialLink,
        bearings: Bearings,
        axis: str,
        acceleration: float,
        words: LaserWords,
        channels: tuple[int, ...],
    ) -> None:
        self.link, self.bearings = link, bearings
        self.dialogue = MarlinDialogue(link)
        self.axis, self.acceleration = axis, acceleration
        self._words, self.channels = words, channels
        self.lit: set[int] = set()

    def still_answers(self) -> bool:
        """Whether a connected board does; where it stands is known then."""
        try:
            self.find_position()
        except PositionUnknown:
            raise
        except DeviceError:
            return False
        return True

    def reopen(self) -> None:
        """Open the port, which resets the board, unless it is one that does not reset."""
        if self.link.is_open:
            self.link.close()
            # So that there is an edge on DTR.
            time.sleep(_CLOSED_S)
        self.link.close()
        self.link.open()
        with self.link.dialogue():
            self._start_up()

    def ask(self, line: str) -> list[str]:
        return self.ask_anew(lambda: line)

    def ask_anew(self, line: Callable[[], str]) -> list[str]:
        """Ask, and once more a board that has reset itself meanwhile; positions in the line are new then.

        Raises:
            PositionUnknown: it did so in mid-move.
        """
        try:
            return self.dialogue.ask(line())
        except MarlinRestarted:
            self.recover()
            return self.dialogue.ask(line())

    def find_position(self) -> None:
        """Where the board says it is; a move that it has not lost is over then."""
        try:
            position = self.dialogue.find_position()
        except MarlinRestarted:
            self.recover()
            position = self.dialogue.find_position()
        self.bearings.arrive(self.steps_told(position))

    def steps_told(self, position: MarlinPosition) -> int:
        return position.count if self.axis == "X" else round(position.extruder * self.bearings.per_deg)

    def recover(self) -> None:
        """The board has reset itself; the angle is kept where the table stood.

        Raises:
            PositionUnknown: it turned.
        """
        was_moving = self.bearings.way is not None
        self._start_up()
        if was_moving:
            raise self.bearings.lost()

    def set_up(self) -> None:
        """Everything that a reset forgets."""
        words = setup_words(self.axis, self.acceleration, FASTEST_DEG_S, self._words.laser)
        per_deg = self.bearings.per_deg
        if steps_per_unit(self.dialogue.ask("M503"), self.axis) != per_deg:
            words += [f"M92 {self.axis}{per_deg:.6f}"]
        for word in words:
            self.dialogue.ask(word)
        self.count_anew(self.dialogue.ask)

    def count_anew(self, ask: Callable[[str], object]) -> None:
        """The place where the table stands is 0 for the board."""
        ask(f"G92 {self.axis}0")
        self.bearings.count_anew()

    def switch(self, channel: int, is_on: bool) -> None:
        """Put a laser on or off; out, where the board does not answer."""
        # Noted as lit from before the command, so that a reset in between lights it again.
        (self.lit.add if is_on else self.lit.discard)(channel)
        try:
            try:
                answer = self._switch_once(channel)
            except DeviceTimeout:
                answer = self._switch_once(channel)
        except (DeviceTimeout, MoveStopped):
            self.lit.discard(channel)
            raise
        self._words.check(self.link.device, channel, answer)

    def set_lasers(self) -> None:
        """All of them as they shall be."""
        for channel in self.channels:
            self._words.check(self.link.device, channel, self.dialogue.ask(self._laser_word(channel)))

    @property
    def words_off(self) -> bytes:
        return b"".join(self._word_off(channel) for channel in self.channels)

    def _switch_once(self, channel: int) -> list[str]:
        with dark_unless_answered(self.link, self._word_off(channel)):
            try:
                return self.dialogue.ask_once(self._laser_word(channel), LASER_ANSWER_S)
            except MarlinRestarted:
                self.recover()
                return self.dialogue.ask_once(self._laser_word(channel), LASER_ANSWER_S)

    def _laser_word(self, channel: int) -> str:
        return self._words.switch(channel, channel in self.lit)

    def _word_off(self, channel: int) -> bytes:
        return f"{self._words.switch(channel, False)}\n".encode()

    def _start_up(self) -> None:
        self.bearings.lose()
        for _ in range(_STARTS):
            with contextlib.suppress(MarlinRestarted):
                self.dialogue.greet()
                self.set_up()
                self.set_lasers()
                return
        raise resets_again(self.link.device)
