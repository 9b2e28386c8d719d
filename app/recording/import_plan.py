"""What pictures somebody took mean: which role, angle, pose and lasers each one has."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.errors import ImportFailed, OptionError
from app.geometry.arrays import Floats
from app.recording.manifest import Direction
from app.recording.period import TurnLength, find_turn
from app.recording.picture import ImageFormat
from app.recording.picture_folder import Order
from app.recording.shot import Role
from app.recording.survey import Survey
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour

Lit: TypeAlias = tuple[str, ...]

_LIT = frozenset({Role.LASER_PLANE, Role.AXIS_LINE, Role.SCAN, Role.BACKGROUND})
_POSED = frozenset({Role.LASER_PLANE, Role.AXIS_LINE})
_NEEDS_ANGLE = frozenset({Role.SCAN, Role.TEXTURE})
_NO_TURN_HINT = (
    "Say how far the table turns from picture to picture, how many turns they show, or how long one takes."
)


@dataclass(frozen=True, slots=True)
class ImportPlan:
    """How to read a folder of pictures or a video.

    At most one of `step_deg`, `turns` and `seconds_per_turn` says how the table turned; where none does, a
    scan's turn is found in its pictures.

    Attributes:
        role: what the pictures are for.
        lasers: colour of every laser by name.
        pattern: which lasers are lit in the pictures of one stop, such as (("left",), ("right",), ()); empty
            where every picture has the same light: all lasers where the role wants light, none otherwise.
        step_deg: angle from stop to stop; a video moves on evenly within a stop.
        turns: that all pictures together show.
        seconds_per_turn: of a video.
        start_deg: angle of the first picture.
        direction: which way the table turns, seen from above; None for that of the recording that is added
            to, or ccw.
        order: of the pictures in a folder.
        every: take one stop of so many.
        board: the calibration board the pictures show.
        platter: the markers that lie on the table.
        image_format: of frames taken from a video.
        quality: of JPEG frames.
    """

    role: Role = Role.SCAN
    lasers: Mapping[str, LaserColour] = field(default_factory=dict)
    pattern: tuple[Lit, ...] = ()
    step_deg: float | None = None
    turns: float | None = None
    seconds_per_turn: float | None = None
    start_deg: float = 0.0
    direction: Direction | None = None
    order: Order = "name"
    every: int = 1
    board: BoardSpec | None = None
    platter: PlatterSpec | None = None
    image_format: ImageFormat = "png"
    quality: int = 95

    def check(self) -> None:
        """Whether the plan makes sense by itself.

        Raises:
            OptionError: it does not.
        """
        ways = {"step_deg": self.step_deg, "turns": self.turns, "seconds_per_turn": self.seconds_per_turn}
        given = {name: value for name, value in ways.items() if value is not None}
        if len(given) > 1:
            raise OptionError("Only one of step, turns and seconds per turn can be given.")
        for name, value in given.items():
            if not (np.isfinite(value) and 0.0 < value <= 1e6):
                raise OptionError(f"{name} must be greater than 0, not {value:g}.")
        if self.every < 1:
            raise OptionError(f"every must be 1 or more, not {self.every}.")
        if self.role in _LIT and not self.lasers:
            raise OptionError(f"Pictures for {self.role.value} need a laser, and none is named.")
        unknown = {name for lit in self.pattern for name in lit} - set(self.lasers)
        if unknown:
            raise OptionError(f"The pattern has {sorted(unknown)[0]!r}, which is not among the lasers.")

    @property
    def cycle(self) -> int:
        """Pictures of one stop."""
        return max(1, len(self.pattern))

    def light(self, place: int) -> Lit:
        """Lasers that were on in the picture at that place."""
        if self.pattern:
            return self.pattern[place % self.cycle]
        return tuple(self.lasers) if self.role in _LIT else ()


@dataclass(frozen=True, slots=True)
class Placed:
    """One picture and its meaning.

    Attributes:
        index: how the source finds it.
        role, lasers_on, angle_deg, pose, time_s: as in `Shot`.
    """

    index: int
    role: Role
    lasers_on: Lit
    angle_deg: float | None
    pose: int | None
    time_s: float | None


@dataclass(frozen=True, eq=False, slots=True)
class Layout:
    """All pictures that go into the recording.

    Attributes:
        placed: in order.
        turn: the length of a turn in pictures, where it had to be found.
        idle: pictures left out because the table did not turn steadily yet, or any more.
    """

    placed: tuple[Placed, ...]
    turn: TurnLength | None
    idle: int


def lay_out(survey: Survey, plan: ImportPlan, name: str, first_pose: int = 0) -> Layout:
    """Give every picture its role, light, angle and pose.

    Args:
        survey: the pictures.
        plan: what the person said of them.
        name: of the source, for messages.
        first_pose: number of the first board pose.

    Raises:
        ImportFailed: angles are wanted, nothing says how the table turned, and the pictures do not either.
        OptionError: seconds per turn are given and the pictures have no times.
    """
    stops = survey.places // plan.cycle
    is_used = stops % plan.every == 0
    angles_deg, turn = _angles(survey, plan, name)
    idle = 0
    if turn is not None:
        first, last = turn.first * plan.cycle, (turn.last + 1) * plan.cycle - 1
        is_turning = (survey.places >= first) & (survey.places <= last)
        idle = int(np.count_nonzero(is_used & ~is_turning))
        is_used &= is_turning
    used = np.flatnonzero(is_used)
    return Layout(tuple(_place(survey, plan, int(k), angles_deg, first_pose) for k in used), turn, idle)


def _place(survey: Survey, plan: ImportPlan, number: int, angles_deg: Floats, first_pose: int) -> Placed:
    place = int(survey.places[number])
    lit = plan.light(place)
    pose = None
    if plan.role in _POSED:
        pose = first_pose + place // plan.cycle
    elif plan.role is Role.AXIS:
        pose = first_pose
    return Placed(
        index=int(survey.indices[number]),
        role=Role.TEXTURE if plan.role is Role.SCAN and not lit else plan.role,
        lasers_on=lit,
        angle_deg=_known(angles_deg[number]),
        pose=pose,
        time_s=_known(survey.times_s[number]),
    )


def _angles(survey: Survey, plan: ImportPlan, name: str) -> tuple[Floats, TurnLength | None]:
    """(K,) angle of every picture, NaN where unknown; the turn where it had to be found."""
    stops = _stops(survey.places, plan, survey.is_steady)
    if plan.step_deg is not None:
        return plan.start_deg + plan.step_deg * stops, None
    if plan.turns is not None:
        every_stop = survey.count / plan.cycle if survey.is_steady else -(-survey.count // plan.cycle)
        return plan.start_deg + 360.0 * plan.turns / every_stop * stops, None
    if plan.seconds_per_turn is not None:
        if not np.isfinite(survey.times_s).all():
            raise OptionError(
                f"Seconds per turn mean nothing for {name}, whose pictures have no times.",
                "Say the step or the number of turns.",
            )
        since_s = survey.times_s - survey.times_s[0]
        return plan.start_deg + 360.0 * since_s / plan.seconds_per_turn, None
    if plan.role not in _NEEDS_ANGLE:
        return np.full(len(survey), np.nan), None
    turn = find_turn(survey.even_thumbnails(plan.cycle))
    if not turn.is_periodic:
        raise ImportFailed(
            f"{name} does not repeat itself within its {len(survey)} pictures, so the length of a turn "
            "cannot be told from them.",
            _NO_TURN_HINT,
        )
    return plan.start_deg + 360.0 * (stops - turn.first) / turn.frames, turn


def _stops(places: NDArray[np.intp], plan: ImportPlan, is_steady: bool) -> Floats:
    """How often the table had moved on before each picture: a fraction where it never stops."""
    stops = places / plan.cycle if is_steady else places // plan.cycle
    return stops.astype(np.float64)


def _known(number: np.float64) -> float | None:
    return float(number) if np.isfinite(number) else None
