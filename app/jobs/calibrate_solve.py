"""From captured pictures to a calibration that has been tried: solved, the table found, proved."""

from dataclasses import replace

from app.calibration.capture import Captured
from app.calibration.capture_solve import calibrate_captured
from app.calibration.outcome import CalibrationOutcome
from app.calibration.plan import CalibrationPlan
from app.calibration.proof import PROOF_KEY, Proof, Verdict, prove
from app.calibration.views import gather
from app.errors import CalibrationError
from app.jobs.table_height import OnProgress, with_reference, with_table
from app.vision.stripe import StripeDetector

_NO_PROOF = "The calibration could not be proved."


def solve_captured(
    captured: Captured, detector: StripeDetector, plan: CalibrationPlan, show: OnProgress
) -> tuple[CalibrationOutcome, Proof | None]:
    """The calibration, and what its proof says; the record keeps both.

    Args:
        captured: the pictures.
        detector: finds the stripes.
        plan: how to calibrate.
        show: told how it goes; what it raises ends the work.

    Raises:
        CalibrationError, FrameError: as `calibrate_captured`.
    """
    outcome = calibrate_captured(captured.recording, detector, plan, show)
    record = with_table(outcome.record, [captured.recording], show)
    outcome = replace(outcome, record=with_reference(record, [captured.recording], show))
    if captured.proof is None:
        return outcome, None
    try:
        evidence = gather(
            [captured.proof], detector, lambda done, total: show("Proving it", done, total),
            skips_bad_frames=True,
        )  # fmt: skip
        proof = prove(evidence, outcome.record)
    except CalibrationError as error:
        doubt = " ".join((_NO_PROOF, error.message, error.hint)).strip()
        return replace(outcome, doubts=(*outcome.doubts, doubt)), None
    bad = tuple(f"{f.words} {f.advice}" for f in proof.findings if f.verdict is Verdict.BAD)
    record = replace(outcome.record, extra={**outcome.record.extra, PROOF_KEY: proof.as_json()})
    return replace(outcome, record=record, doubts=outcome.doubts + bad), proof


def with_findings(outcome: CalibrationOutcome, proof: Proof | None) -> CalibrationOutcome:
    """The outcome with what the proof found among its notes, for the report."""
    if proof is None:
        return outcome
    said = tuple(
        f"Proof, {f.verdict.value}: {f.words}" for f in proof.findings if f.verdict is not Verdict.BAD
    )
    return replace(outcome, notes=(*said, *outcome.notes))
