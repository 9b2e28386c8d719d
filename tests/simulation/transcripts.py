"""The recorded dialogues of real boards, and a player that takes an emulator through them in virtual time."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.simulation.firmware.kernel import Firmware

BOARDS = Path(__file__).resolve().parents[3] / "shared" / "boards.md"

_CONTROLS = {"⏎": b"\r\n", "␊": b"\n", "␍": b"\r"}
_TIMES = re.compile(r"\((\d+) times (.)\)")
_REPEATED = re.compile(r"(.)…\((\d+)\)")
_NUMBER = r"-?\d+(?:\.\d+)?"
_LATENCY = re.compile(rf"({_NUMBER})(?:\s*…\s*({_NUMBER}))?")
_LASER = re.compile(r"laser(\d+) (on|off)(?: at (-?\d+))?")
_PULSES = re.compile(r"(\w) (-?\d+)→(-?\d+), (\d+) pulses in ([\d.]+) s")
_MORE = re.compile(r"… (\d+) more")


@dataclass(frozen=True, slots=True)
class Travel:
    """Pulses that went to one motor.

    Attributes:
        axis: `x`, `t` or `e`.
        begin, end: position before and after; a move belongs to the row in which it ends.
        pulses: how many; duration_s: from the first to the last of them.
    """

    axis: str
    begin: int
    end: int
    pulses: int
    duration_s: float


@dataclass(frozen=True, slots=True)
class Row:
    """One request with all that was seen.

    Attributes:
        text: the request as the table writes it; `(open)` for opening the port.
        request: its bytes; empty for `(open)`.
        reply: what the whole reply must match; None where nothing came.
        first_ms, last_ms: from the last byte of the request, or from opening, to the first and the last byte
            of the reply. The same where the table has one number for a short reply.
        lasers: (output, whether it goes on, position in steps where the table says it), in order.
        driver: whether it goes on, in order.
        travel: pulses of the table's motor.
        lost_bytes: of the request.
        is_cut: whether the list of events in the table ends with "… n more".
        note: the words after the events.
        line: in boards.md, for messages.
    """

    text: str
    request: bytes
    reply: re.Pattern[bytes] | None
    first_ms: float | None
    last_ms: float | None
    lasers: tuple[tuple[int, bool, int | None], ...]
    driver: tuple[bool, ...]
    travel: Travel | None
    lost_bytes: int
    is_cut: bool
    note: str
    line: int

    @property
    def is_open(self) -> bool:
        return self.text == "(open)"


@dataclass(frozen=True, slots=True)
class Setting:
    """What surrounded a row and its table does not say.

    Attributes:
        before: bytes sent before the request, each with the seconds until what comes next. What is said
            to them belongs to the row's reply; latencies and switching count from the request on.
        quiet_s: how long the recorder listened after the last byte that it expected.
    """

    before: Sequence[tuple[bytes, float]] = ()
    quiet_s: float = 0.4


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a latency may be from the recorded one; boards vary by a main-loop turn and a timer tick.

    Attributes:
        least_ms: always allowed.
        part: of the latency.
    """

    least_ms: float = 2.0
    part: float = 0.05

    def allows(self, recorded_ms: float, played_ms: float) -> bool:
        return abs(played_ms - recorded_ms) <= max(self.least_ms, self.part * abs(recorded_ms))


@dataclass(frozen=True, slots=True)
class Played:
    """What an emulator did in a row; fields as in `Row`.

    Latencies are NaN where no byte came after the request had begun.
    """

    reply: bytes
    first_ms: float
    last_ms: float
    lasers: tuple[tuple[int, bool, int], ...]
    driver: tuple[bool, ...]
    begin: int
    end: int
    lost_bytes: int

    def differences(
        self, row: Row, tolerance: Tolerance | None = None, *, skip: Sequence[str] = ()
    ) -> list[str]:
        """Where this is not what was recorded; empty when all is.

        Args:
            row: what was recorded.
            tolerance: for latencies.
            skip: aspects not to look at: `reply`, `latency`, `lasers`, `driver`, `travel`, `lost`.
        """
        tolerance = tolerance or Tolerance()
        found: list[tuple[str, str]] = []
        if row.reply is None and self.reply:
            found.append(("reply", f"said {self.reply!r} instead of nothing"))
        elif row.reply is not None and not row.reply.fullmatch(self.reply):
            found.append(("reply", f"said {self.reply!r} instead of {row.reply.pattern!r}"))
        for name, recorded, played in (
            ("first", row.first_ms, self.first_ms),
            ("last", row.last_ms, self.last_ms),
        ):
            if recorded is not None and not tolerance.allows(recorded, played):
                found.append(("latency", f"{name} byte after {played:.1f} instead of {recorded:.1f} ms"))
        lasers = self.lasers[: len(row.lasers)] if row.is_cut else self.lasers
        if not _same_switching(row.lasers, lasers):
            found.append(("lasers", f"switched lasers {self.lasers} instead of {row.lasers}"))
        if self.driver != row.driver and not row.is_cut:
            found.append(("driver", f"switched the driver {self.driver} instead of {row.driver}"))
        begin, end = (row.travel.begin, row.travel.end) if row.travel else (self.begin, self.begin)
        if (self.begin, self.end) != (begin, end):
            found.append(("travel", f"went {self.begin}→{self.end} instead of {begin}→{end}"))
        if self.lost_bytes != row.lost_bytes:
            found.append(("lost", f"lost {self.lost_bytes} bytes instead of {row.lost_bytes}"))
        return [difference for aspect, difference in found if aspect not in skip]


class Player:
    """Plays rows one after the other against one emulator; time goes on from row to row.

    A move that is still under way when a row is over counts in the row in which it ends, as in the tables.
    """

    def __init__(self, firmware: Firmware) -> None:
        self.firmware = firmware
        self.now_s = 0.0
        self._stood_at = 0

    def play(self, row: Row, setting: Setting | None = None) -> Played:
        """Send the row's request, listen until its reply is over, and tell what happened."""
        setting = setting or Setting()
        firmware, plant = self.firmware, self.firmware.plant
        lost_before = firmware.lost_bytes
        begin = self._stood_at
        for data, wait_s in setting.before:
            firmware.receive(data, self.now_s)
            self._pass(wait_s)
        asked_s = self.now_s
        if row.is_open:
            firmware.reset(asked_s)
            ended_s = asked_s
        else:
            firmware.receive(row.request, asked_s)
            ended_s = asked_s + len(row.request) * firmware.byte_s
        self.now_s = ended_s
        self._pass((row.last_ms or 0.0) / 1000.0 + setting.quiet_s)
        sent = firmware.sent_with_times(self.now_s)
        after = [1000.0 * (at - ended_s) for at, _ in sent if at > asked_s]
        if not plant.at(self.now_s).is_moving:
            self._stood_at = self._steps_at(self.now_s)
        events = [event for event in plant.events if event.time_s >= asked_s]
        return Played(
            reply=bytes(byte for _, byte in sent),
            first_ms=after[0] if after else math.nan,
            last_ms=after[-1] if after else math.nan,
            lasers=tuple(
                (event.output, event.what == "laser on", self._steps_at(event.time_s))
                for event in events
                if event.what.startswith("laser")
            ),
            driver=tuple(event.what == "driver on" for event in events if event.what.startswith("driver")),
            begin=begin,
            end=self._stood_at,
            lost_bytes=firmware.lost_bytes - lost_before,
        )

    def _pass(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.firmware.advance(self.now_s)

    def _steps_at(self, time_s: float) -> int:
        plant = self.firmware.plant
        return round(plant.at(time_s).angle_deg * plant.wiring.steps_per_turn / 360.0)


def read_transcript(title: str, path: Path = BOARDS) -> list[Row]:
    """The rows of the table under `### Transcript: <title>`, where a longer title may begin with it.

    A test is skipped where the file is missing; where the file has no such table it fails.
    """
    if not path.is_file():
        pytest.skip(f"recorded dialogues not found at {path}")
    rows, is_inside = [], False
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        if line.startswith("#"):
            is_inside = line.startswith(f"### Transcript: {title}")
        elif is_inside and line.startswith("| `"):
            rows.append(_row(line, number))
    assert rows, f"{path.name} has no transcript of {title}"
    return rows


def row_names(rows: Sequence[Row]) -> list[str]:
    """One name for each row, for messages."""
    return [f"{row.line} {row.text[:24]}" for row in rows]


def _row(line: str, number: int) -> Row:
    # A bar inside a cell is escaped.
    request, reply, latency, note = (
        cell.strip().replace(r"\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]
    )
    text = request.strip("`")
    found = _LATENCY.match(latency)
    first = float(found[1]) if found else None
    last = float(found[2] or found[1]) if found else None
    events, _, words = note.partition(" — ")
    if not _is_events(events):
        events, words = "", note
    travelled = _PULSES.search(events)
    more = _MORE.search(events)
    return Row(
        text=text,
        request=_request(text),
        reply=None if not reply.startswith("`") else _reply(reply.strip("`")),
        first_ms=first,
        last_ms=last,
        lasers=tuple(
            (int(output), state == "on", int(at) if at else None)
            for output, state, at in _LASER.findall(events)
        ),
        driver=tuple(state == "on" for state in re.findall(r"driver (on|off)", events)),
        travel=_travel(travelled) if travelled else None,
        lost_bytes=_lost(events, more),
        is_cut=more is not None and "byte lost" not in events,
        note=words,
        line=number,
    )


def _is_events(text: str) -> bool:
    first = text.split(";")[0]
    return bool(re.match(r"(laser\d|driver|pwm|ring|fan|reset\b|byte lost)", first) or _PULSES.match(first))


def _travel(found: re.Match[str]) -> Travel:
    return Travel(found[1], int(found[2]), int(found[3]), int(found[4]), float(found[5]))


def _lost(events: str, more: re.Match[str] | None) -> int:
    shown = events.count("byte lost")
    return shown + (int(more[1]) if shown and more else 0)


def _request(text: str) -> bytes:
    if text == "(open)":
        return b""
    if text == "(0x80..0xff)":
        return bytes(range(0x80, 0x100)) + b"\n"
    if found := _TIMES.fullmatch(text):
        return found[2].encode() * int(found[1]) + b"\n"
    if found := re.fullmatch(r"(\d+) times (.*)", text):
        return b"".join(word.encode() + b"\n" for word in found[2].split()) * int(found[1])
    return _decoded(text)


def _reply(text: str) -> re.Pattern[bytes]:
    """`A…(200)` is a character many times; any other ` … ` stands for what the table leaves out."""
    whole = _REPEATED.sub(lambda found: found[1] * int(found[2]), text)
    parts = [re.escape(_decoded(part)) for part in whole.split(" … ")]
    return re.compile(b".*".join(parts), re.DOTALL)


def _decoded(text: str) -> bytes:
    """Bytes of a cell: control pictures, and `\\x18` for one byte."""
    data = b""
    for piece in re.split(r"(\\x[0-9a-f]{2}|[⏎␊␍])", text):
        if piece.startswith("\\x"):
            data += bytes([int(piece[2:], 16)])
        else:
            data += _CONTROLS.get(piece) or piece.encode("latin-1")
    return data


def _same_switching(
    recorded: Sequence[tuple[int, bool, int | None]], played: Sequence[tuple[int, bool, int]]
) -> bool:
    return len(recorded) == len(played) and all(
        (output, state) == (other, other_state) and at in (None, other_at)
        for (output, state, at), (other, other_state, other_at) in zip(recorded, played, strict=True)
    )
