"""What is said of a table that was measured."""

import math

from app.checkup.finding import Finding, State
from app.devices.bench_file import BenchDescription

# Degrees in a whole turn, and degrees of play or lost: what is worth a word, and what spoils scans.
_SCALE_LIMIT_DEG, _SCALE_BAD_DEG = 0.2, 2.0
_OFF_LIMIT_DEG, _OFF_BAD_DEG = 0.12, 0.6
# No table stands better than to so much of its smallest turn.
_SMALLEST_SHARE = 0.6


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
    limit_deg = max(_SCALE_LIMIT_DEG, _SMALLEST_SHARE * smallest_deg)
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
        numbers, values={"example": round(3200.0 / scale)},
    )  # fmt: skip


def judge_play(play_deg: float, smallest_deg: float) -> Finding:
    numbers = {"play_deg": round(play_deg, 3)}
    if not math.isfinite(play_deg):
        return _unseen("turntable.play", numbers)
    if play_deg <= max(_OFF_LIMIT_DEG, _SMALLEST_SHARE * smallest_deg):
        return Finding(
            "turntable.play", State.OK, f"The table has {play_deg:.2f} degrees of play.", "", numbers
        )
    return Finding(
        "turntable.play", State.BAD if play_deg > 10 * _OFF_BAD_DEG else State.ATTENTION,
        f"Coming from the other side, the table stands {play_deg:.2f} degrees elsewhere: it has play.",
        "Tighten the belt, gear or grub screw. Scans turn one way only and suffer little; going back to an "
        "angle does.", numbers,
    )  # fmt: skip


def judge_lost_steps(lost_deg: float, moves: int, smallest_deg: float) -> Finding:
    numbers = {"lost_deg": round(lost_deg, 3), "moves": moves}
    if not math.isfinite(lost_deg):
        return _unseen("turntable.lost-steps", numbers)
    if lost_deg <= max(_OFF_LIMIT_DEG, _SMALLEST_SHARE * smallest_deg):
        return Finding(
            "turntable.lost-steps", State.OK,
            f"After {moves} quick moves the table stands where it stood to {lost_deg:.2f} degrees.",
            "", numbers,
        )  # fmt: skip
    return Finding(
        "turntable.lost-steps", State.BAD if lost_deg > _OFF_BAD_DEG else State.ATTENTION,
        f"After {moves} quick moves the table is {lost_deg:.2f} degrees off: it loses steps.",
        "Lower speed and acceleration in the bench file, give the motor driver more current, and see that "
        "the table turns freely and does not slip.", numbers,
    )  # fmt: skip


def no_board_turns_it() -> Finding:
    sentence = "No board turns the table: its turns were not measured."
    return Finding("turntable.turn", State.SKIPPED, sentence, kind="no-board")


def nothing_to_see(description: BenchDescription) -> Finding:
    has_any = description.platter is not None or description.board is not None
    if has_any:
        return Finding(
            "turntable.turn", State.SKIPPED,
            "Neither the table's markers nor the calibration board are in view: its turns were not measured.",
            "Stand the calibration board on the table facing the camera, or uncover the markers.",
            kind="hidden",
        )  # fmt: skip
    return Finding(
        "turntable.turn", State.SKIPPED,
        "The bench file names neither markers nor a board to watch.",
        "Print markers with `turnscan platter`, fix them on the table and add a [platter] table to the bench "
        "file; or stand the calibration board on the table and add [board].", kind="nothing",
    )  # fmt: skip


def _unseen(check: str, numbers: dict[str, float]) -> Finding:
    return Finding(
        check, State.SKIPPED, "The markers or the board went out of sight, so this was not measured.",
        "Take away what hides them.", dict.fromkeys(numbers),
    )  # fmt: skip
