"""A board that was typed in, as a turntable wants it: place known, lasers as they were asked for."""

from app.devices.bearings import Bearings
from app.devices.laser_care import LASER_ANSWER_S, dark_unless_answered
from app.devices.template_dialogue import TemplateDialogue
from app.errors import DeviceError


class TemplateBoard:
    """What a board forgets when it starts anew, and what is asked of it when it did not answer.

    Attributes:
        dialogue: request and answer.
        bearings: where the table stands.
        lit: lasers that are on, or perhaps are.
    """

    def __init__(self, dialogue: TemplateDialogue, bearings: Bearings, *, where_in_steps: bool) -> None:
        self.dialogue, self.bearings = dialogue, bearings
        self._where_in_steps = where_in_steps
        self.lit: set[int] = set()

    def begin(self) -> None:
        """A board that has just started, or whose port was just opened.

        Raises:
            PositionUnknown: its table turned when it was last heard of.
        """
        self.dialogue.greet()
        lit, self.lit = self.lit, set()
        self.bearings.count_anew(self.count_told() or 0.0)
        if self.bearings.way is not None:
            self.darken()
            raise self.bearings.lost()
        for channel in self.dialogue.words.channels:
            self.switch(channel, channel in lit)

    def find_out(self, timeout_s: float) -> None:
        """Get in step with a board that did not answer, and learn where its table stands.

        Args:
            timeout_s: what is under way may have to end before it answers.

        Raises:
            PositionUnknown: it cannot tell.
        """
        self.dialogue.get_in_step(timeout_s)
        if not self.take_position() and self.bearings.way is not None:
            raise self.bearings.lost()

    def take_position(self) -> bool:
        """Ask where the table stands, where the template can; whether it can."""
        told = self.count_told()
        if told is not None:
            self.bearings.arrive(told)
        return told is not None

    def count_told(self) -> int | None:
        """Where the board says it stands; None where it cannot."""
        if self.dialogue.words.where.is_empty:
            return None
        told = self.dialogue.ask_position()
        return round(told if self._where_in_steps else told * self.bearings.per_deg)

    def switch(self, channel: int, is_on: bool) -> None:
        """Put a laser on or off; out, where the board does not answer."""
        words = self.dialogue.words
        if is_on:
            # Counted as lit from before the command.
            self.lit.add(channel)
        try:
            with dark_unless_answered(self.dialogue.link, words.line_off(channel)):
                command = words.laser[is_on].fill({"channel": channel})
                timeout_s = min(self.dialogue.answer_s, LASER_ANSWER_S)
                self.dialogue.request(command, words.laser_done, timeout_s)
        except DeviceError:
            self.lit.discard(channel)
            raise
        if not is_on:
            self.lit.discard(channel)

    def darken(self) -> None:
        for channel in self.dialogue.words.channels:
            self.switch(channel, False)

    def give_current(self, is_holding: bool) -> None:
        """Hold the table or let it go; to be told only where the template can."""
        words = self.dialogue.words
        self.dialogue.request(words.motor[is_holding].fill({}), words.done)
