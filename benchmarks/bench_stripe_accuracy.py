"""How near each detector comes to the Cramer-Rao bound, and how it behaves at a step in depth."""

import numpy as np

from app.geometry.arrays import Floats
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView
from benchmarks.report import Row, at_least, at_most
from benchmarks.stripe_scenes import SCENES, Scene, step_pair

_SEEDS = 6
_NEAR_STEP_LINES = 4


def run() -> list[Row]:
    rows = []
    for scene in SCENES:
        limit = 0.85 if scene.contrast > 0.0 else 0.90
        for name in ("zero-crossing", "centroid", "threshold"):
            errors, sigmas = errors_of(name, scene)
            what = f"{scene.name}: {name}"
            if len(errors) < 0.5 * _SEEDS * scene.lines:
                rows.append(Row(what, 0.0, "", note="no stripe found"))
                continue
            squares = float(np.mean(errors**2))
            efficiency = scene.bound_px() ** 2 / squares
            note = f"RMS {squares**0.5:.3f} px, bound {scene.bound_px():.3f} px"
            if name != "zero-crossing":
                rows.append(Row(what, efficiency, "of the bound", note=note))
                continue
            rows.append(at_least(what, efficiency, "of the bound", limit, note))
            told = float(np.sqrt(np.mean((errors / sigmas) ** 2)))
            rows.append(
                Row(f"{scene.name}: error / its sigma", told, "RMS", "0.8 .. 1.25", 0.8 <= told <= 1.25)
            )
    rows += [_depth_steps(smooth_rows) for smooth_rows in (0, 7)]
    return rows


def errors_of(detector: str, scene: Scene, seeds: int = _SEEDS) -> tuple[Floats, Floats]:
    """Errors (N,) and told sigmas (N,) in px of all points of some pictures of a scene."""
    errors, sigmas = [], []
    for seed in range(seeds):
        stripe = detected(detector, scene, seed)
        errors.append(stripe.pixels[:, 0] - scene.truth()[stripe.line])
        sigmas.append(np.sqrt(stripe.variance))
    return np.concatenate(errors), np.concatenate(sigmas)


def detected(detector: str, scene: Scene, seed: int) -> LaserStripe:
    lit, dark = scene.pair(seed)
    return STRIPE_DETECTORS.make(detector).detect(LaserView(lit, dark, "red"))


def wrong_at_steps(smooth_rows: int, seeds: int = _SEEDS) -> tuple[int, int]:
    """How many points within four lines of a step in depth are off by more than 1 px, of how many."""
    detector = STRIPE_DETECTORS.make("zero-crossing", smooth_rows=smooth_rows)
    wrong = near = 0
    for seed in range(seeds):
        lit, dark, truth, steps = step_pair(seed)
        stripe = detector.detect(LaserView(lit, dark, "red"))
        is_near = (np.abs(stripe.line[:, None] - steps + 0.5) <= _NEAR_STEP_LINES).any(axis=1)
        error = np.abs(stripe.pixels[:, 0] - truth[stripe.line])[is_near]
        wrong, near = wrong + int((error > 1.0).sum()), near + int(is_near.sum())
    return wrong, near


def _depth_steps(smooth_rows: int) -> Row:
    wrong, near = wrong_at_steps(smooth_rows)
    what = f"points within 4 lines of a depth step off by more than 1 px, smooth_rows = {smooth_rows}"
    return at_most(what, 100.0 * wrong / max(near, 1), "%", 0.0, f"of {near} points")
