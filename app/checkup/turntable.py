"""Which way the table turns, how far, whether it loses steps, and how much play it has."""

import math
from dataclasses import dataclass

from app.checkup.examination import Examination
from app.checkup.finding import Finding, State
from app.checkup.target import Corners, Target
from app.checkup.turn_words import (
    judge_direction,
    judge_lost_steps,
    judge_play,
    judge_scale,
    no_board_turns_it,
    nothing_to_see,
)
from app.checkup.turning import Sway, guessed_camera, turned_deg
from app.devices.frame import Use

_NUDGE_DEG = 3.0
# The table is brought to every stance from the same side, so that play does not count.
_RUN_UP_DEG = 10.0
# Of corners for a degree, in a picture of 1000 columns.
_STILL_PX = 0.06
# Beyond these factors something else is wrong than a number.
_LEAST_SCALE, _MOST_SCALE = 0.05, 20.0
# A turn that the two pictures before and after it still have enough corners in common for.
_GOOD_TURN_DEG = 25.0
_CLOSINGS = 5
_CLOSED_DEG = 0.5
_SWINGS, _SWING_DEG = 4, 120.0
_LOOK_AGAIN = "Take away what hides the markers or the board, and check that there is enough light."


@dataclass(frozen=True, slots=True)
class Turn:
    """What a table makes of its angles.

    Attributes:
        scale: degrees turned for one degree that the board is told.
        is_ccw: whether it turns counter-clockwise, seen from above, as angles grow.
        closed_at_deg: the angle, as told, where the first picture came again.
        sway: how the corners move about that stance.
    """

    scale: float
    is_ccw: bool
    closed_at_deg: float
    sway: Sway


class UnmeasuredError(Exception):
    """The pictures did not tell; caught here, and told as a finding."""

    def __init__(self, kind: str, sentence: str, advice: str = "") -> None:
        super().__init__(sentence)
        self.kind, self.sentence, self.advice = kind, sentence, advice or _LOOK_AGAIN


def measure_turntable(exam: Examination) -> tuple[Finding, ...]:
    """Direction, steps per turn, lost steps and play, by what is seen on the table."""
    facts = exam.bench.turntable.facts
    if facts.turns_by_itself or not facts.fastest_deg_s:
        return (no_board_turns_it(),)
    found = exam.target()
    if found is None:
        return (nothing_to_see(exam.bench.description),)
    watch = _Watch(exam, found[0])
    exam.bench.turntable.hold(True)
    try:
        turn = measure_turn(watch)
    except UnmeasuredError as error:
        return (Finding("turntable.turn", State.BAD, error.sentence, error.advice, kind=error.kind),)
    smallest_deg = facts.smallest_deg
    return (
        judge_direction(turn.is_ccw, exam.bench.description.turntable.direction == "ccw"),
        judge_scale(turn.scale, smallest_deg),
        judge_play(measure_play(watch, turn), smallest_deg),
        judge_lost_steps(measure_lost_steps(watch, turn), 2 * _SWINGS, smallest_deg),
    )


def measure_turn(watch: "_Watch") -> Turn:
    """Turn until the first picture comes again: exact, whatever the camera.

    Raises:
        UnmeasuredError: with what was in the way.
    """
    tell = watch.exam.tell
    tell("direction")
    home_deg = watch.approach(watch.angle_deg)
    before_deg, before = watch.nudge(home_deg - _NUDGE_DEG)
    at_deg, at = watch.nudge(home_deg)
    after_deg, after = watch.nudge(home_deg + _NUDGE_DEG)
    sway = Sway.between(before, at, after, after_deg - before_deg)
    if not math.isfinite(sway.speed_px):
        raise UnmeasuredError("unseen", f"The {watch.target.name} on the table could not be followed.")
    if sway.speed_px < _STILL_PX * watch.width / 1000.0:
        raise UnmeasuredError(
            "still",
            "The table does not turn, though the board says that it does.",
            "Check the motor's plug, its power supply and the driver's current, and whether the table slips.",
        )
    rough = turned_deg(watch.target, before, after, watch.camera) / (after_deg - before_deg)
    if not math.isfinite(rough):
        raise UnmeasuredError(
            "unseen", f"Too little of the {watch.target.name} is in view to tell how far the table turns."
        )
    reach_deg = _GOOD_TURN_DEG / min(max(abs(rough), 0.1), 50.0)
    far_deg, far = watch.nudge(at_deg + reach_deg)
    better = turned_deg(watch.target, at, far, watch.camera) / (far_deg - at_deg)
    if abs(better) < _LEAST_SCALE or abs(better) > _MOST_SCALE:
        raise UnmeasuredError(
            "scale",
            f"Asked for {far_deg - at_deg:.0f} degrees, it turns about {better * (far_deg - at_deg):.0f}.",
            "Set the steps per turn in the bench file to what the motor and its gear really need.",
        )
    if not math.isfinite(better):
        raise UnmeasuredError("unseen", f"The {watch.target.name} went out of sight as the table turned.")
    tell("one turn")
    closed_deg = _close(watch, sway, at_deg, at_deg + 360.0 / abs(better))
    return Turn(360.0 / (closed_deg - at_deg), better > 0.0, closed_deg, sway)


def measure_play(watch: "_Watch", turn: Turn) -> float:
    """Degrees of the table between coming from one side and from the other."""
    watch.exam.tell("play")
    from_below = watch.off_deg(turn, turn.closed_at_deg)
    watch.move(turn.closed_at_deg + _RUN_UP_DEG / turn.scale)
    reached_deg = watch.move(turn.closed_at_deg)
    from_above = turn.sway.off_deg(watch.look()) - (reached_deg - turn.closed_at_deg)
    return abs(from_above - from_below) * turn.scale


def measure_lost_steps(watch: "_Watch", turn: Turn) -> float:
    """Degrees of the table by which it is off after going there and back at full speed."""
    watch.exam.tell("lost steps")
    before = watch.off_deg(turn, turn.closed_at_deg)
    for _ in range(_SWINGS):
        watch.move(turn.closed_at_deg + _SWING_DEG)
        watch.move(turn.closed_at_deg - _RUN_UP_DEG / turn.scale)
    return abs(watch.off_deg(turn, turn.closed_at_deg) - before) * turn.scale


class _Watch:
    """Turns the table and follows the target."""

    def __init__(self, exam: Examination, target: Target) -> None:
        self.exam, self.target = exam, target
        size = exam.bench.camera.facts.size
        self.width = size[0]
        known = exam.calibration
        is_known = known is not None and known.camera.size == size
        self.camera = known.camera if known is not None and is_known else guessed_camera(size)

    @property
    def angle_deg(self) -> float:
        return self.exam.bench.turntable.angle_deg

    def move(self, angle_deg: float) -> float:
        """Go there, and the angle that was reached."""
        reached_deg = self.exam.bench.turntable.move_to(angle_deg)
        self.exam.settle()
        return reached_deg

    def approach(self, angle_deg: float) -> float:
        """Go there from below."""
        self.move(angle_deg - _NUDGE_DEG - _RUN_UP_DEG)
        return angle_deg

    def look(self) -> Corners:
        return self.target.find(self.exam.picture(Use.BOARD).image(grey=True))

    def nudge(self, angle_deg: float) -> tuple[float, Corners]:
        """Go on to an angle: what was reached, and what is seen."""
        return self.move(angle_deg), self.look()

    def off_deg(self, turn: Turn, angle_deg: float) -> float:
        """Come to an angle near the stance from below; how far off it the table is, degrees as told."""
        self.move(angle_deg - _RUN_UP_DEG / turn.scale)
        reached_deg, seen = self.nudge(angle_deg)
        return turn.sway.off_deg(seen) - (reached_deg - turn.closed_at_deg)


def _close(watch: _Watch, sway: Sway, from_deg: float, guess_deg: float) -> float:
    """The angle, as told, at which the first stance comes again after one turn."""
    for _ in range(_CLOSINGS):
        # From below again, wherever the guess before it was.
        watch.move(guess_deg - _RUN_UP_DEG)
        reached_deg, seen = watch.nudge(guess_deg)
        off_deg = sway.off_deg(seen)
        if not math.isfinite(off_deg):
            break
        guess_deg = reached_deg - off_deg
        if abs(off_deg) < _CLOSED_DEG:
            return guess_deg
    raise UnmeasuredError(
        "unclosed",
        f"After about {guess_deg - from_deg:.0f} degrees the {watch.target.name} did not come back to where "
        "they began.",
    )
