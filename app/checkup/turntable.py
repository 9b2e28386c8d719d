"""Which way the table turns, how far, whether it loses steps, and how much play it has."""

import math
from dataclasses import dataclass

from app.checkup.examination import Examination
from app.checkup.finding import Finding, State
from app.checkup.target import Corners, Target
from app.checkup.turning import Sway, guessed_camera, turned_deg
from app.devices.frame import Use
from app.errors import ScannerError

_NUDGE_DEG = 3.0
# The table is brought to every stance from the same side, so that play does not count.
_RUN_UP_DEG = 10.0
_STILL_PX = 0.02
# A turn that the two pictures before and after it still have enough corners in common for.
_GOOD_TURN_DEG = 25.0
_CLOSINGS = 5
_CLOSED_DEG = 0.5
_SCALE_LIMIT_DEG, _SCALE_BAD_DEG = 0.2, 2.0
_OFF_LIMIT_DEG, _OFF_BAD_DEG = 0.12, 0.6
_SWINGS, _SWING_DEG = 4, 120.0


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


class NotMeasured(ScannerError):
    """The pictures did not tell."""

    code = "not-measured"
    hint = "Take away what hides the markers or the board, and check that there is enough light."


def measure_turntable(exam: Examination) -> tuple[Finding, ...]:
    """Direction, steps per turn, lost steps and play, by what is seen on the table."""
    found = exam.target()
    if found is None:
        return (_nothing_to_see(exam),)
    watch = _Watch(exam, found[0])
    exam.bench.turntable.hold(True)
    try:
        turn = measure_turn(watch)
    except NotMeasured as error:
        return (Finding("turntable.turn", State.BAD, error.message, error.hint),)
    entry = exam.bench.description.turntable
    return (
        judge_direction(turn.is_ccw, entry.direction == "ccw"),
        judge_scale(turn.scale, exam.bench.turntable.facts.smallest_deg),
        judge_play(measure_play(watch, turn), exam.bench.turntable.facts.smallest_deg),
        judge_lost_steps(measure_lost_steps(watch, turn), exam.bench.turntable.facts.smallest_deg),
    )


def measure_turn(watch: "_Watch") -> Turn:
    """Turn until the first picture comes again: exact, whatever the camera.

    Raises:
        NotMeasured: with what was in the way.
    """
    home_deg = watch.approach(watch.angle_deg)
    before_deg, before = watch.nudge(home_deg - _NUDGE_DEG)
    at_deg, at = watch.nudge(home_deg)
    after_deg, after = watch.nudge(home_deg + _NUDGE_DEG)
    sway = Sway.between(before, at, after, after_deg - before_deg)
    if not math.isfinite(sway.speed_px):
        raise NotMeasured(f"The {watch.target.name} on the table could not be followed.")
    if sway.speed_px < _STILL_PX * watch.width / 1000.0:
        raise NotMeasured(
            "The table does not turn, though the board says that it does.",
            "Check the motor's plug, its power supply and the driver's current, and whether the table slips.",
        )
    rough = turned_deg(watch.target, before, after, watch.camera) / (after_deg - before_deg)
    if not math.isfinite(rough):
        raise NotMeasured(
            f"Too little of the {watch.target.name} is in view to tell how far the table turns."
        )
    reach_deg = _GOOD_TURN_DEG / min(max(abs(rough), 0.1), 50.0)
    far_deg, far = watch.nudge(at_deg + reach_deg)
    better = turned_deg(watch.target, at, far, watch.camera) / (far_deg - at_deg)
    if not math.isfinite(better):
        raise NotMeasured(f"The {watch.target.name} went out of sight as the table turned.")
    closed_deg = _close(watch, sway, at_deg, at_deg + 360.0 / abs(better))
    return Turn(360.0 / (closed_deg - at_deg), better > 0.0, closed_deg, sway)


def measure_play(watch: "_Watch", turn: Turn) -> float:
    """Degrees of the table between coming from one side and from the other."""
    from_below = watch.off_deg(turn, turn.closed_at_deg)
    watch.move(turn.closed_at_deg + _RUN_UP_DEG / turn.scale)
    reached_deg = watch.move(turn.closed_at_deg)
    from_above = turn.sway.off_deg(watch.look()) - (reached_deg - turn.closed_at_deg)
    return abs(from_above - from_below) * turn.scale


def measure_lost_steps(watch: "_Watch", turn: Turn) -> float:
    """Degrees of the table by which it is off after going there and back at full speed."""
    before = watch.off_deg(turn, turn.closed_at_deg)
    for _ in range(_SWINGS):
        watch.move(turn.closed_at_deg + _SWING_DEG)
        watch.move(turn.closed_at_deg - _RUN_UP_DEG / turn.scale)
    return abs(watch.off_deg(turn, turn.closed_at_deg) - before) * turn.scale


def judge_direction(is_ccw: bool, is_said_ccw: bool) -> Finding:
    way, word = ("counter-clockwise", "ccw") if is_ccw else ("clockwise", "cw")
    sentence = f"Seen from above, the table turns {way} as angles grow"
    if is_ccw == is_said_ccw:
        return Finding(
            "turntable.direction", State.OK, f"{sentence}, as the bench file says.", "", {"way": word}
        )
    return Finding(
        "turntable.direction", State.BAD, f"{sentence}; the bench file says the opposite: wrong direction.",
        f'Write direction = "{word}" under [turntable] in the bench file. Scans come out mirrored otherwise.',
        {"way": word},
    )  # fmt: skip


def judge_scale(scale: float, smallest_deg: float) -> Finding:
    turned = 360.0 * scale
    numbers = {"turned_for_360_deg": round(turned, 3), "steps_per_turn_factor": round(1.0 / scale, 5)}
    limit_deg = max(_SCALE_LIMIT_DEG, 0.6 * smallest_deg)
    if abs(turned - 360.0) <= limit_deg:
        return Finding(
            "turntable.steps", State.OK, f"Asked for 360 degrees, the table turns {turned:.2f}.", "", numbers
        )
    state = State.BAD if abs(turned - 360.0) > _SCALE_BAD_DEG else State.ATTENTION
    return Finding(
        "turntable.steps", state,
        f"Asked for 360 degrees, the table turns {turned:.2f}: the steps per turn are wrong.",
        f"Multiply the steps per turn (or per degree) in the bench file by {1.0 / scale:.5f}, "
        f"for example 3200 becomes {3200.0 / scale:.0f}; or set the driver's micro-steps accordingly.",
        numbers,
    )  # fmt: skip


def judge_play(play_deg: float, smallest_deg: float) -> Finding:
    numbers = {"play_deg": round(play_deg, 3)}
    if not math.isfinite(play_deg):
        return _unseen("turntable.play", numbers)
    if play_deg <= max(_OFF_LIMIT_DEG, 0.6 * smallest_deg):
        return Finding(
            "turntable.play", State.OK, f"The table has {play_deg:.2f} degrees of play.", "", numbers
        )
    return Finding(
        "turntable.play", State.BAD if play_deg > 10 * _OFF_BAD_DEG else State.ATTENTION,
        f"Coming from the other side, the table stands {play_deg:.2f} degrees elsewhere: it has play.",
        "Tighten the belt, gear or grub screw. Scans turn one way only and suffer little; going back to an "
        "angle does.", numbers,
    )  # fmt: skip


def judge_lost_steps(lost_deg: float, smallest_deg: float) -> Finding:
    numbers = {"lost_deg": round(lost_deg, 3), "moves": 2 * _SWINGS}
    if not math.isfinite(lost_deg):
        return _unseen("turntable.lost-steps", numbers)
    if lost_deg <= max(_OFF_LIMIT_DEG, 0.6 * smallest_deg):
        return Finding(
            "turntable.lost-steps", State.OK,
            f"After {2 * _SWINGS} quick moves the table is back to {lost_deg:.2f} degrees: no steps are lost.",
            "", numbers,
        )  # fmt: skip
    return Finding(
        "turntable.lost-steps", State.BAD if lost_deg > _OFF_BAD_DEG else State.ATTENTION,
        f"After {2 * _SWINGS} quick moves the table is {lost_deg:.2f} degrees off: it loses steps.",
        "Lower speed and acceleration in the bench file, give the motor driver more current, and see that the "
        "table turns freely and does not slip.", numbers,
    )  # fmt: skip


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
    raise NotMeasured(
        f"After about {guess_deg - from_deg:.0f} degrees the {watch.target.name} did not come back to where "
        "they began."
    )


def _nothing_to_see(exam: Examination) -> Finding:
    has_any = exam.bench.description.platter is not None or exam.bench.description.board is not None
    if has_any:
        return Finding(
            "turntable.turn", State.SKIPPED,
            "Neither the table's markers nor the calibration board are in view, so its turning was not measured.",
            "Stand the calibration board on the table facing the camera, or take away what hides the markers.",
        )  # fmt: skip
    return Finding(
        "turntable.turn", State.SKIPPED, "The bench file names neither markers nor a board to watch the table by.",
        "Print markers with `turnscan platter`, fix them on the table and add a [platter] table to the bench "
        "file; or stand the calibration board on the table and add [board].",
    )  # fmt: skip


def _unseen(check: str, numbers: dict[str, float]) -> Finding:
    return Finding(
        check, State.SKIPPED, "The markers or the board went out of sight, so this was not measured.",
        "Take away what hides them.", {name: None for name in numbers},
    )  # fmt: skip
