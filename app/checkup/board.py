"""The controller board, by what it says of itself."""

import math

from app.checkup.examination import Examination
from app.checkup.finding import Finding, State
from app.devices.turntable import TurntableFacts

_COARSE_DEG = 0.9


def measure_board(exam: Examination) -> tuple[Finding, ...]:
    """Firmware and abilities; nothing moves."""
    facts = exam.bench.turntable.facts
    return (
        Finding(
            "board.firmware", State.OK, f"The board is {facts.firmware} at {facts.port or 'no port'}.", "",
            {"firmware": facts.firmware, "port": facts.port, "laser_channels": len(facts.laser_channels)},
        ),
        judge_step(facts),
        judge_speed(facts),
    )  # fmt: skip


def judge_step(facts: TurntableFacts) -> Finding:
    numbers = {"smallest_deg": round(facts.smallest_deg, 4)}
    sentence = f"Its smallest turn is {facts.smallest_deg:.3g} degrees"
    if facts.smallest_deg < _COARSE_DEG:
        return Finding("board.step", State.OK, f"{sentence}.", "", numbers)
    steps = math.floor(360.0 / facts.smallest_deg)
    return Finding(
        "board.step", State.ATTENTION, f"{sentence}, which is coarse.",
        f"Scan with --steps {steps} or a divisor of it, or load a firmware that takes fractions of degrees.",
        numbers, values={"steps": steps},
    )  # fmt: skip


def judge_speed(facts: TurntableFacts) -> Finding:
    numbers = {
        "slowest_deg_s": facts.slowest_deg_s,
        "fastest_deg_s": facts.fastest_deg_s if math.isfinite(facts.fastest_deg_s) else None,
        "tells_position": int(facts.tells_position),
        "can_stop": int(facts.can_stop),
    }
    if not facts.can_turn_steadily:
        kind, sentence = "steps", "It cannot turn at a given speed: scans are taken step by step."
    elif math.isfinite(facts.fastest_deg_s):
        kind = "limited"
        sentence = (
            f"It turns at up to {facts.fastest_deg_s:.3g} degrees a second, steadily where it is asked to."
        )
    else:
        kind, sentence = "steady", "It turns steadily where it is asked to."
    return Finding("board.speed", State.OK, sentence, "", numbers, kind)
