"""Commands with holes for numbers, as a person types them for a board that nobody knows.

Nothing is evaluated: a placeholder is a name from a list, and what goes in is a number.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.errors import OptionError

_HOLE = re.compile(r"\{([^{}]*)\}")
_ESCAPE = re.compile(r"\\(x[0-9a-fA-F]{2}|[rnt\\])")
_ESCAPED = {"r": "\r", "n": "\n", "t": "\t", "\\": "\\"}


@dataclass(frozen=True, slots=True)
class CommandTemplate:
    r"""A command such as `G1 X{angle} F{speed}`.

    Attributes:
        field: the option it was typed into, for messages.
        parts: text and names in turn; text first and last.
    """

    field: str
    parts: tuple[str, ...]

    @property
    def names(self) -> frozenset[str]:
        """The placeholders that are in it."""
        return frozenset(self.parts[1::2])

    @property
    def is_empty(self) -> bool:
        return self.parts == ("",)

    def fill(self, values: Mapping[str, float], decimals: int = 3) -> bytes:
        """The command with numbers in it; whole ones without a point."""
        filled = list(self.parts)
        filled[1::2] = [_written(values[name], decimals) for name in self.parts[1::2]]
        return "".join(filled).encode("latin-1")


def parse_template(
    field: str, text: str, known: Sequence[str], needed: Sequence[str] = ()
) -> CommandTemplate:
    r"""Read a command; `\x18`, `\r`, `\n`, `\t` and `\\` stand for control bytes.

    Args:
        field: the option it was typed into.
        known: placeholders it may have.
        needed: one of these has to be there, unless there are none.

    Raises:
        OptionError: naming the field and the placeholder.
    """
    allowed = ", ".join("{" + name + "}" for name in known) or "no placeholders"
    parts = _HOLE.split(text)
    for name in parts[1::2]:
        if name not in known:
            raise OptionError(
                f"The template's field {field!r} has a placeholder {{{name}}} that means nothing.",
                f"It may use {allowed}.",
            )
    if any("{" in piece or "}" in piece for piece in parts[0::2]):
        raise OptionError(
            f"The template's field {field!r} has a bracket that is not closed, or one too many.",
            f"It may use {allowed}.",
        )
    if needed and not set(needed) & set(parts[1::2]):
        one = " or ".join("{" + name + "}" for name in needed)
        raise OptionError(f"The template's field {field!r} lacks the placeholder {one}.", f"Put {one} in.")
    parts[0::2] = [unescaped(field, piece) for piece in parts[0::2]]
    return CommandTemplate(field, tuple(parts))


def unescaped(field: str, text: str) -> str:
    """Text with its control bytes in place.

    Raises:
        OptionError: a character that no byte stands for.
    """
    plain = _ESCAPE.sub(lambda found: _ESCAPED.get(found[1]) or chr(int(found[1][1:], 16)), text)
    if any(ord(character) > 0xFF for character in plain):
        raise OptionError(f"The template's field {field!r} has a character that a serial port cannot carry.")
    return plain


def parse_answer(field: str, text: str, *, groups: int | None = None) -> str:
    """Make sure that a regular expression is one.

    Args:
        groups: how many it must have; None for any number.

    Raises:
        OptionError: naming the field.
    """
    try:
        # It stands in a group beside others when it is used.
        found = re.compile(f"(?:{text})(?P<failed>)(?P<banner>)".encode("latin-1"))
    except (re.error, UnicodeEncodeError) as error:
        raise OptionError(f"The template's field {field!r} is not a regular expression ({error}).") from error
    if groups is not None and text and found.groups != groups + 2:
        raise OptionError(
            f"The template's field {field!r} must have one pair of round brackets, around the number."
        )
    return text


def parse_plain(field: str, text: str) -> CommandTemplate:
    """A command without placeholders. Raises as `parse_template`."""
    return parse_template(field, text, ())


def check_texts(fields: Mapping[str, object]) -> None:
    """Options that must be text; as all of these, raises `OptionError` naming the field."""
    for field, text in fields.items():
        if not isinstance(text, str):
            raise OptionError(f"The template's field {field!r} must be text, not {text!r}.")


def check_present(fields: Mapping[str, str]) -> None:
    """Options that no template can do without."""
    for field, text in fields.items():
        if not text:
            raise OptionError(f"The template's field {field!r} is missing.", "A template needs it.")


def check_pairs(pairs: Mapping[str, tuple[str, str]]) -> None:
    """Two options, named with a space between them, that make sense only together."""
    for fields, (first, second) in pairs.items():
        if bool(first) != bool(second):
            given, lacking = fields.split() if first else reversed(fields.split())
            raise OptionError(
                f"The template's field {lacking!r} is missing.", f"It belongs to {given!r}, which is there."
            )


def check_numbers(fields: Mapping[str, float], *, or_zero: bool = False) -> None:
    """Options that must be positive and finite."""
    for field, value in fields.items():
        is_fine = isinstance(value, int | float) and math.isfinite(value)
        if not is_fine or value < 0.0 or (value == 0.0 and not or_zero):
            raise OptionError(
                f"The template's field {field!r} cannot be {value!r}.", "Give a positive number."
            )


def _written(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text
