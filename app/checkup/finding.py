"""What a checkup says: findings, and the report they make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum

from app.documents import Json


class State(StrEnum):
    """How something is."""

    OK = "ok"
    ATTENTION = "attention"
    BAD = "bad"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        check: what, such as `turntable.direction`; the part before the dot is its group.
        state: how it is.
        sentence: what was measured.
        advice: what to do about it; empty where nothing is to be done.
        numbers: as measured; names carry their units.
        kind: which of the things that can be said of this check in this state; empty where there is but one.
        values: what else the sentence and the advice name.
    """

    check: str
    state: State
    sentence: str
    advice: str = ""
    numbers: Mapping[str, float | int | str | None] = field(default_factory=dict)
    kind: str = ""
    values: Mapping[str, float | int | str] = field(default_factory=dict)

    @property
    def code(self) -> str:
        """Names the sentence, whatever its values, so that a page can say it in another language."""
        group, _, thing = self.check.partition(".")
        said_of = f"{group}.{thing.partition('.')[0]}" if thing else "checkup"
        return f"{said_of}.{self.kind or self.state.value}"

    @property
    def is_trouble(self) -> bool:
        return self.state in (State.ATTENTION, State.BAD)


@dataclass(frozen=True, slots=True)
class Report:
    """Everything a checkup found.

    Attributes:
        bench: its name.
        findings: in the order in which they were made.
        created: when, in UTC.
    """

    bench: str
    findings: Sequence[Finding]
    created: datetime = field(default_factory=lambda: datetime.now(UTC).replace(microsecond=0))

    @property
    def troubles(self) -> tuple[Finding, ...]:
        """What needs somebody's attention, the worst first."""
        found = [finding for finding in self.findings if finding.is_trouble]
        return tuple(sorted(found, key=lambda finding: finding.state is not State.BAD))

    def as_json(self) -> Json:
        return {
            "format": "turnscan-checkup",
            "version": 1,
            "bench": self.bench,
            "created": self.created.isoformat().replace("+00:00", "Z"),
            "is_well": not self.troubles,
            "findings": [
                {
                    "check": finding.check,
                    "state": finding.state.value,
                    "sentence": finding.sentence,
                    "advice": finding.advice,
                    "numbers": dict(finding.numbers),
                    "code": finding.code,
                    "values": dict(finding.values),
                }
                for finding in self.findings
            ],
        }
