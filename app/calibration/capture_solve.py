"""The calibration from what was captured, without the stripes that no plane explains."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from app.calibration.calibrate import calibrate_evidence
from app.calibration.outcome import CalibrationOutcome
from app.calibration.plan import CalibrationPlan
from app.calibration.views import View, gather
from app.recording.reader import Recording
from app.vision.stripe import StripeDetector

# A stripe that misses its plane by so many times what is usual, and by more than good ones ever do.
_ODD_TIMES, _ODD_PX = 3.0, 0.25
_ROUNDS = 4
_FEWEST_STRIPES = 5


def calibrate_captured(
    recording: Recording,
    detector: StripeDetector,
    plan: CalibrationPlan,
    on_progress: Callable[[str, int, int | None], None] = lambda stage, done, total: None,
) -> CalibrationOutcome:
    """Calibrate jointly from a captured recording.

    Light that grazes the board makes a broad stripe in the wrong place, all of it alike, so that no loss for
    single points finds it. Such views are at the ends of the table's range and others can do without them.

    Raises:
        CalibrationError, FrameError: as `calibrate`.
    """
    evidence = gather(
        [recording], detector, lambda done, total: on_progress("Looking at pictures", done, total)
    )
    outcome = calibrate_evidence(evidence, plan, on_progress)
    left_out: list[tuple[str, str]] = []
    for _ in range(_ROUNDS):
        odd = _odd_stripes(outcome)
        if not odd:
            break
        left_out += [(name, f"the stripe of laser {laser} misses its plane by {px:.1f} px")
                     for (name, laser), px in odd.items()]  # fmt: skip
        evidence = replace(evidence, views=tuple(_without(view, odd) for view in evidence.views))
        outcome = calibrate_evidence(evidence, plan, on_progress)
    return replace(outcome, dropped=outcome.dropped + tuple(left_out))


def _odd_stripes(outcome: CalibrationOutcome) -> dict[tuple[str, str], float]:
    """Misfit, px, of stripes that do not belong, by frame and laser; never so many that few are left."""
    odd: dict[tuple[str, str], float] = {}
    for laser in outcome.record.lasers:
        off = {view.name: view.stripe_px[laser] for view in outcome.views if laser in view.stripe_px}
        limit = max(_ODD_TIMES * float(np.median(list(off.values()))), _ODD_PX) if off else np.inf
        worst = sorted((name for name in off if off[name] > limit), key=off.__getitem__, reverse=True)
        odd |= {(name, laser): off[name] for name in worst[: max(0, len(off) - _FEWEST_STRIPES)]}
    return odd


def _without(view: View, odd: dict[tuple[str, str], float]) -> View:
    stripes = {laser: stripe for laser, stripe in view.stripes.items() if (view.name, laser) not in odd}
    return replace(view, stripes=stripes)
