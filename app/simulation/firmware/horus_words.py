"""How the Horus firmware reads a line of G-code: words, and what it says when they are wrong."""

import math
import re
from dataclasses import dataclass

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_COMMANDS = {"G": (1, 50), "M": (0, 2, 17, 18, 50, 70, 71)}


@dataclass(frozen=True, slots=True)
class Words:
    """A line that was understood.

    Attributes:
        commands: such as `G1` or `M71`, in order.
        values: of F, T and X, where given.
    """

    commands: tuple[str, ...]
    values: dict[str, float]


def read_number(text: str, at: int) -> tuple[float, int] | None:
    """A number at a place and where it ends; None where there is none."""
    found = _NUMBER.match(text, at)
    return (float(found[0]), found.end()) if found else None


def read_words(line: str, commands: dict[str, tuple[int, ...]] | None = None) -> Words | str:
    """The words of a line in capitals without spaces, or the words of an error.

    A command other than G1, M0 and M2 has no modal group of its own and falls into that of the word before
    it; that is why two of them on one line are refused.
    """
    known = commands or _COMMANDS
    at, group = 0, ""
    found: list[str] = []
    groups: set[str] = set()
    values: dict[str, float] = {}
    while at < len(line):
        letter = line[at]
        if not "A" <= letter <= "Z":
            return "Expected command letter"
        number = read_number(line, at + 1)
        if number is None:
            return "Bad number format"
        value, at = number
        whole = math.trunc(value)
        if letter in known:
            if whole not in known[letter]:
                return "Unsupported command"
            if value != whole:
                return "Invalid gcode ID:23"
            name = f"{letter}{whole}"
            group = {"G1": "motion", "M0": "flow", "M2": "flow"}.get(name, group)
            if group in groups:
                return "Modal group violation"
            groups.add(group)
            found.append(name)
        elif letter in "FTX":
            group = letter
            if letter in values:
                return "Invalid gcode ID:25"
            if letter != "X" and value < 0.0:
                return "Value < 0"
            values[letter] = value
        else:
            return "Unsupported command"
    return Words(tuple(found), values)


def commands_without(*names: str) -> dict[str, tuple[int, ...]]:
    """The commands that an older firmware knows."""
    return {
        letter: tuple(number for number in numbers if f"{letter}{number}" not in names)
        for letter, numbers in _COMMANDS.items()
    }
