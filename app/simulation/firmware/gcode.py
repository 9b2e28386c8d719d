"""Words of G-code, and the state that they leave behind, with the error numbers of Grbl."""

import re
from dataclasses import dataclass, replace

_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_GROUPS: dict[str, dict[float, str]] = {
    "G": {
        0: "motion", 1: "motion", 80: "motion", 4: "once", 53: "once", 92: "once", 92.1: "once",
        17: "plane", 20: "units", 21: "units", 90: "distance", 91: "distance", 94: "feed mode",
        40: "cutter", 49: "length", 54: "offset", 61: "path", 91.1: "arc",
    },
    "M": {0: "flow", 1: "flow", 2: "flow", 30: "flow", 3: "spindle", 4: "spindle", 5: "spindle",
          8: "coolant", 9: "coolant"},
}  # fmt: skip
_VALUES = "FSTPNXYZABC"


class GcodeError(Exception):
    """The error number that the board answers."""

    def __init__(self, number: int) -> None:
        super().__init__(f"error:{number}")
        self.number = number


@dataclass(frozen=True, slots=True)
class Modal:
    """What later lines take over; as after a reset."""

    motion: int = 0
    is_inches: bool = False
    is_relative: bool = False
    feed: float = 0.0
    spindle: int = 5
    has_coolant: bool = False
    power: float = 0.0
    tool: int = 0

    def report(self) -> str:
        """The answer to `$G`, without brackets."""
        motion = "G80" if self.motion == 80 else f"G{self.motion}"
        return (
            f"GC:{motion} G54 G17 G{20 if self.is_inches else 21} G{91 if self.is_relative else 90} G94 "
            f"M{self.spindle} M{8 if self.has_coolant else 9} T{self.tool} F{self.feed:.0f} S{self.power:.0f}"
        )


@dataclass(frozen=True, slots=True)
class Line:
    """One line, understood.

    Attributes:
        modal: the state after it.
        values: numbers by letter.
        once: the G-code for this line only, or None.
        flow: M0, M2 or M30, or None.
        switches: whether it names a spindle or coolant state.
    """

    modal: Modal
    values: dict[str, float]
    once: float | None
    flow: int | None
    switches: bool

    def has_axes(self, letters: str) -> bool:
        return any(letter in self.values for letter in letters)


def understand(
    text: str, modal: Modal, axes: str, extra: dict[str, frozenset[float]] | None = None, *, is_jog: bool
) -> Line:
    """What a line (without spaces and comments, in capitals) asks for.

    Args:
        axes: letters of the board's axes.
        extra: further words that the board takes and that do nothing here.
        is_jog: the line comes with `$J=`, which allows only some words.

    Raises:
        GcodeError: with Grbl's number.
    """
    codes: dict[str, tuple[str, float]] = {}
    values: dict[str, float] = {}
    for letter, number in _words(text):
        if letter in "GM":
            if number in (extra or {}).get(letter, ()):
                continue
            group = _GROUPS[letter].get(number)
            if group is None:
                raise GcodeError(20)
            if group in codes:
                raise GcodeError(21)
            if is_jog and (letter == "M" or number not in (20, 21, 53, 90, 91)):
                raise GcodeError(16)
            codes[group] = (letter, number)
        elif letter not in _VALUES or (letter in "XYZABC" and letter not in axes):
            raise GcodeError(20)
        elif letter in values:
            raise GcodeError(25)
        elif number < 0.0 and letter in "FNPST":
            raise GcodeError(4)
        else:
            values[letter] = number
    after = _modal_after(modal, codes, values)
    line = Line(
        after,
        values,
        codes["once"][1] if "once" in codes else None,
        int(codes["flow"][1]) if "flow" in codes else None,
        "spindle" in codes or "coolant" in codes or "S" in values,
    )
    _check(line, codes, axes, is_jog=is_jog)
    return line


def _words(text: str) -> list[tuple[str, float]]:
    found, at = [], 0
    while at < len(text):
        if not "A" <= text[at] <= "Z":
            raise GcodeError(1)
        word = _WORD.match(text, at)
        if word is None:
            raise GcodeError(2)
        found.append((word[1], float(word[2])))
        at = word.end()
    return found


def _modal_after(modal: Modal, codes: dict[str, tuple[str, float]], values: dict[str, float]) -> Modal:
    def code(group: str, otherwise: int) -> int:
        return int(codes[group][1]) if group in codes else otherwise

    is_inches = code("units", 20 if modal.is_inches else 21) == 20
    return replace(
        modal,
        motion=code("motion", modal.motion),
        is_inches=is_inches,
        is_relative=code("distance", 91 if modal.is_relative else 90) == 91,
        feed=values["F"] * (25.4 if is_inches else 1.0) if "F" in values else modal.feed,
        spindle=code("spindle", modal.spindle),
        has_coolant=code("coolant", 8 if modal.has_coolant else 9) == 8,
        power=values.get("S", modal.power),
        tool=int(values.get("T", modal.tool)),
    )


def _check(line: Line, codes: dict[str, tuple[str, float]], axes: str, *, is_jog: bool) -> None:
    has_axes = line.has_axes(axes)
    if line.once == 92 and not has_axes:
        raise GcodeError(26)
    if line.once == 92 and "motion" in codes:
        raise GcodeError(24)
    if line.once == 4 and "P" not in line.values:
        raise GcodeError(28)
    if "P" in line.values and line.once != 4:
        raise GcodeError(36)
    if is_jog:
        if not has_axes:
            raise GcodeError(16)
        if "F" not in line.values:
            raise GcodeError(22)
        return
    if line.once == 53 and line.modal.motion not in (0, 1):
        raise GcodeError(30)
    if has_axes and line.once in (None, 53):
        if line.modal.motion == 80:
            raise GcodeError(31)
        if line.modal.motion == 1 and line.modal.feed == 0.0:
            raise GcodeError(22)
