"""The whole checkup: one group of checks after the other, whatever one of them runs into."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.checkup.board import measure_board
from app.checkup.camera import measure_camera
from app.checkup.examination import Examination
from app.checkup.finding import Finding, Report, State
from app.checkup.lasers import measure_lasers
from app.checkup.machine import measure_machine
from app.checkup.picture import measure_picture
from app.checkup.turntable import measure_turntable
from app.errors import DeviceError, OptionError


@dataclass(frozen=True, slots=True)
class Check:
    """A group of findings that are made together.

    Attributes:
        name: of the group.
        words: what is done, for whoever waits.
        measure: does it.
        needs_board, needs_camera: the devices it cannot do without.
    """

    name: str
    words: str
    measure: Callable[[Examination], Sequence[Finding]]
    needs_board: bool = True
    needs_camera: bool = True


CHECKS = (
    Check("board", "Asking the board", measure_board, needs_camera=False),
    # The latency first: pictures of a camera that does not tell its times are right only once it is known.
    Check("camera", "Timing the camera", measure_camera),
    Check("machine", "Trying the disk", measure_machine, needs_board=False),
    Check("lasers", "Switching the lasers", measure_lasers),
    Check("picture", "Looking at pictures", measure_picture),
    Check("turntable", "Turning the table", measure_turntable),
)


def chosen(names: Sequence[str]) -> tuple[Check, ...]:
    """The checks of these names; all for none.

    Raises:
        OptionError: there is no such check.
    """
    known = {check.name: check for check in CHECKS}
    for name in names:
        if name not in known:
            raise OptionError(f"There is no check called {name!r}.", f"There are: {', '.join(known)}.")
    return tuple(check for check in CHECKS if not names or check.name in names)


def checkup(
    exam: Examination, checks: Sequence[Check], progress: Callable[[str, int, int], None] | None = None
) -> Report:
    """Measure a bench. Its lasers are off and its table stands on every way out, for the lease sees to it.

    Args:
        exam: of a bench that is connected as far as it can be.
        checks: which.
        progress: told what is done now, how many checks are through, and of how many.

    Raises:
        BenchBusy: a job holds the bench.
    """
    findings: list[Finding] = []
    with exam.bench.lease("a checkup"):
        for number, check in enumerate(checks):
            if progress is not None:
                progress(check.words, number, len(checks))
            findings += _measured(exam, check)
    if progress is not None:
        progress("Done", len(checks), len(checks))
    return Report(exam.bench.description.name, tuple(findings))


def _measured(exam: Examination, check: Check) -> Sequence[Finding]:
    missing = _missing(exam, check)
    if missing:
        return (
            Finding(
                check.name, State.SKIPPED, f"Not looked at, for the {missing} is not connected.",
                "Connect it and run the checkup again.", kind="missing", values={"device": missing},
            ),
        )  # fmt: skip
    try:
        return check.measure(exam)
    except DeviceError as error:
        return (Finding(check.name, State.BAD, f"{error.message}.", error.hint, kind="failed"),)


def _missing(exam: Examination, check: Check) -> str:
    bench = exam.bench
    if check.needs_board and not bench.turntable.is_connected:
        return "board"
    if check.needs_camera and not bench.camera.state.is_connected:
        return "camera"
    return ""
