"""What a benchmark reports, and how it is shown."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table


@dataclass(frozen=True, slots=True)
class Row:
    """One measured number.

    Attributes:
        what: the thing that was measured.
        value, unit: how much.
        target: what was wanted, in words such as "<= 2.5"; empty where nothing was.
        is_met: whether it was reached; None where there is no target.
        note: how to read the number.
    """

    what: str
    value: float
    unit: str
    target: str = ""
    is_met: bool | None = None
    note: str = ""


def at_most(what: str, value: float, unit: str, limit: float, note: str = "") -> Row:
    """A row whose value must not be above the limit."""
    return Row(what, value, unit, f"<= {limit:g}", value <= limit, note)


def at_least(what: str, value: float, unit: str, limit: float, note: str = "") -> Row:
    """A row whose value must not be below the limit."""
    return Row(what, value, unit, f">= {limit:g}", value >= limit, note)


def table_of(title: str, rows: Sequence[Row]) -> Table:
    """The rows as a table for the terminal."""
    table = Table(title=title, title_justify="left")
    table.add_column("what")
    table.add_column("measured", justify="right")
    table.add_column("target")
    table.add_column("met")
    table.add_column("note", overflow="fold")
    words = {True: "yes", False: "NO", None: ""}
    for row in rows:
        table.add_row(row.what, f"{row.value:.4g} {row.unit}", row.target, words[row.is_met], row.note)
    return table
