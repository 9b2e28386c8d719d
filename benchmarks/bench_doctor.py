"""What the doctor names on simulated benches with a fault planted in each: every fault, and nothing else."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.checkup.checkup import checkup, chosen
from app.checkup.examination import Examination
from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.recording.manifest_facts import PlatterFacts
from benchmarks.report import Row, at_least, at_most

_PLATTER = PlatterFacts(kind="aruco", dictionary="DICT_4X4_50", marker_mm=14.0, ids=tuple(range(8)))


@dataclass(frozen=True, slots=True)
class _Planted:
    """A fault, the findings that name it, and the checks that are run (all for none)."""

    what: str
    named: frozenset[str]
    simulation: Mapping[str, Any] = field(default_factory=dict)
    checks: tuple[str, ...] = ("turntable",)


_LATENCY = frozenset({"camera.latency"})
_PLANTED = (
    _Planted("wrong direction", frozenset({"turntable.direction"}), {"wrong_direction": True}),
    _Planted("3150 steps per turn", frozenset({"turntable.steps"}), {"steps_per_turn": 3150.0}),
    _Planted("6400 steps per turn", frozenset({"turntable.steps"}), {"steps_per_turn": 6400.0}),
    _Planted("play of 0.5 degrees", frozenset({"turntable.play"}), {"play_deg": 0.5}),
    _Planted("swapped lasers", frozenset({"lasers.which"}), {"swapped_lasers": True}, ("lasers",)),
    _Planted("120 ms latency", _LATENCY, {"camera_latency_s": 0.12, "has_timestamps": False}, ("camera",)),
    _Planted("two stale frames", frozenset({"camera.stale"}), {"stale_frames": 2}, ("camera",)),
    _Planted(
        "saturated stripe",
        frozenset({"picture.saturation.left", "picture.saturation.right"}),
        {"saturated": True},
        ("picture",),
    ),
)


def run() -> list[Row]:
    found = [_named(planted) == planted.named for planted in _PLANTED]
    missed = ", ".join(each.what for each, is_found in zip(_PLANTED, found, strict=True) if not is_found)
    note = f"not or not alone: {missed}" if missed else ", ".join(each.what for each in _PLANTED)
    healthy = _named(_Planted("nothing", frozenset(), checks=()))
    return [
        at_least(
            "planted faults that the doctor names, and no other", sum(found), "faults", len(found), note
        ),
        at_most(
            "alarms on a healthy bench, all checks", len(healthy), "alarms", 0, ", ".join(sorted(healthy))
        ),
    ]


def _named(planted: _Planted) -> frozenset[str]:
    """Everything that was not in order; at true speed, 720 rows."""
    described = simulated_description(**planted.simulation).model_copy(update={"platter": _PLATTER})
    with Bench.build(described) as bench, tempfile.TemporaryDirectory() as folder:
        bench.connect()
        report = checkup(Examination(bench, Path(folder)), chosen(planted.checks))
    return frozenset(finding.check for finding in report.troubles)
