"""How a calibration goes, as a page shows it: where it is, what to do next, what was taken."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Spot: TypeAlias = tuple[float, float]
"""A place in the picture: share of its width from the left, of its height from the top."""


class Kind(StrEnum):
    """Ways to calibrate."""

    AUTOMATIC = "automatic"
    FULL = "full"
    CAMERA = "camera"
    TABLE = "table"
    PAPER = "paper"


class Step(StrEnum):
    """What is done one after the other; those that a kind has no use for are left out."""

    CAMERA = "camera"
    LASERS = "lasers"
    BOARD = "board"
    PROOF = "proof"
    TABLE = "table"
    SOLVING = "solving"
    PROVING = "proving"
    DONE = "done"


class Sight(StrEnum):
    """What the newest picture shows of the board."""

    UNKNOWN = "unknown"
    UNSEEN = "unseen"
    MOVING = "moving"
    STILL = "still"
    TAKEN = "taken"


@dataclass(frozen=True, slots=True)
class Instruction:
    """What to do now.

    Attributes:
        code: for translation: those of `Wish`, and `hold-board`, `show-lasers`, `place-board`,
            `place-board-again`, `clear-table`, `wait`, `device-away`, `done`.
        words: the same, a sentence.
        target: where in the picture the board should go; None for anywhere.
        problem: why it is asked for again; empty for the first time.
    """

    code: str
    words: str
    target: Spot | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Arrow:
    """From where the board is seen to where it should go."""

    tail: Spot
    head: Spot


@dataclass(frozen=True, slots=True)
class ViewState:
    """One view that was taken.

    Attributes:
        number: of the view, for `strike` and its thumbnail.
        step: camera, lasers or board.
        pose: number of the board's place, where it has one.
        angle_deg: of the table, where it stood on it.
        corners: how many corners were found.
        outline: the board's outermost corners, in the order of a walk around; empty where not found.
        rms_px: how well it fits the others; None while nobody knows.
        is_struck: whether it is left out.
        reason: why.
    """

    number: int
    step: Step
    pose: int | None
    angle_deg: float | None
    corners: int
    outline: tuple[Spot, ...]
    rms_px: float | None
    is_struck: bool
    reason: str


@dataclass(frozen=True, slots=True)
class CalibrationState:
    """A calibration at one moment.

    Attributes:
        job_id: of its job.
        session: name of the folder of its pictures, to go on with.
        kind: how it is done.
        steps: all it consists of, in their order.
        step: where it is.
        done: how much of the step is done, 0..1.
        instruction: what to do now.
        waits_for_person: whether nothing happens until somebody says `continue`.
        may_continue: whether `continue` does something: ends the waiting, or the camera's views.
        may_take: whether `take` does something.
        sight: what the newest picture shows.
        outline: where the board is in it; empty where it is not.
        arrow: on the picture; None where there is nothing to point at.
        said: what happened last.
        coverage: corners of the camera's views in each cell of a coarse grid over the picture, row by row.
        coverage_share: part of the cells that hold one.
        views: what was taken.
        taken: counts up with every view, for a sound.
        width, height: of the pictures, px.
    """

    job_id: str
    session: str
    kind: Kind
    steps: tuple[Step, ...]
    step: Step
    done: float
    instruction: Instruction
    waits_for_person: bool
    may_continue: bool
    may_take: bool
    sight: Sight
    outline: tuple[Spot, ...]
    arrow: Arrow | None
    said: str
    coverage: tuple[tuple[int, ...], ...]
    coverage_share: float
    views: tuple[ViewState, ...]
    taken: int
    width: int
    height: int
