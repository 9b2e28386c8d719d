"""Small, fast simulated benches with something planted, and what a checkup says of them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from app.calibration.record import CalibrationRecord
from app.checkup.checkup import checkup, chosen
from app.checkup.examination import Examination
from app.checkup.finding import Finding, Report
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, simulated_description
from app.recording.manifest_facts import CharucoFacts, PlatterFacts

PLATTER = PlatterFacts(kind="aruco", dictionary="DICT_4X4_50", marker_mm=14.0, ids=tuple(range(8)))
BOARD = CharucoFacts(
    kind="charuco", columns=9, rows=7, square_mm=9.0, marker_mm=6.75, dictionary="DICT_4X4_50"
)
FASTER = 32.0


def described(dialect: str = "horus", **planted: object) -> BenchDescription:
    """A bench with markers on its table."""
    usual: dict[str, object] = {"width": 640, "height": 360, "rate": FASTER, "object": "sphere"}
    return simulated_description(dialect, **(usual | planted)).model_copy(update={"platter": PLATTER})


@contextmanager
def examined(description: BenchDescription, folder: Path) -> Iterator[Examination]:
    """It, connected."""
    with Bench.build(description) as bench:
        bench.connect()
        yield Examination(bench, folder)


def report_of(
    description: BenchDescription,
    folder: Path,
    only: Sequence[str] = (),
    prepare: Callable[[Examination], None] = lambda exam: None,
) -> Report:
    """What the doctor says.

    Args:
        prepare: does something to the bench beforehand.
    """
    with examined(description, folder) as exam:
        prepare(exam)
        return checkup(exam, chosen(only))


def named(report: Report) -> dict[str, Finding]:
    """What needs attention, by its check."""
    return {finding.check: finding for finding in report.troubles}


def measured(report: Report, check: str, number: str) -> float:
    """A number of a finding."""
    finding = next(finding for finding in report.findings if finding.check == check)
    value = finding.numbers[number]
    assert isinstance(value, int | float)
    return value


def true_calibration(exam: Examination) -> CalibrationRecord:
    """What a perfect calibration would find."""
    assert exam.bench.world is not None
    rig = exam.bench.world.rig
    return CalibrationRecord(camera=rig.camera, lasers=rig.lasers, axis=rig.axis)
