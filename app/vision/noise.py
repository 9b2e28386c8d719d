"""The stripe's width and the camera's noise, told by the picture itself."""

import numpy as np
from scipy.optimize import nnls

from app.geometry.arrays import Floats
from app.vision.kernels import Kernels
from app.vision.kernels.results import SCORING_REACH, Shape, Windows

_LINES = 160
_BINS = 12
_ROUNDS = 3
_LEAST_PIXELS = 400
# No camera is better than its rounding to whole grey levels.
_LEAST_VARIANCE = 1.0 / 12.0


def measured_shape(windows: Windows, shape: Shape, kernels: Kernels, is_sigma_known: bool) -> Shape:
    """The shape with stripe sigma, speckle contrast, gain and read noise as this picture has them.

    A sample of the lines is fitted, and what is left over speaks. The squared residual at a place of
    brightness m is C^2 m^2 + m / K + v0 on average, less the share that the fit of position and height has
    taken up; the three terms, none below zero, are fitted to the means of brightness classes. The residual's
    share along dm/dsigma corrects the sigma that all lines have in common. Then the fit is repeated.

    Args:
        windows: with nothing in `floor`, so that the background's noise is part of the answer.
        shape: start; returned as it is where the picture has too few lines.
        kernels: that fit.
        is_sigma_known: leaves the sigma alone.
    """
    lines = np.arange(len(windows.signal))[:: max(1, len(windows.signal) // _LINES)]
    sample = windows.select(lines)
    half = sample.signal.shape[1] // 2
    offsets = np.arange(-half, half + 1)
    for _ in range(_ROUNDS):
        _, fit = kernels.refine(sample, shape, True)
        distance = offsets - fit.offset[:, None]
        inside = sample.usable & fit.is_found[:, None] & (np.abs(distance) <= SCORING_REACH * shape.sigma)
        if np.count_nonzero(inside) < _LEAST_PIXELS:
            return shape
        bell = np.exp(-(distance**2) / (2.0 * shape.sigma**2))
        model = fit.amplitude[:, None] * bell
        residual = sample.signal - model
        weight = np.where(inside, 1.0 / _noise(model, shape), 0.0)
        by_height, by_place = weight * bell * bell, weight * (bell * distance) ** 2
        taken = by_height / _total(by_height) + by_place / _total(by_place)
        level = model[inside]
        square = (residual[inside] ** 2) / np.maximum(1.0 - taken[inside], 0.2)
        sigma = (
            shape.sigma
            if is_sigma_known
            else _better_sigma(shape.sigma, distance, bell, model, residual, weight)
        )
        shape = _with_noise(shape, level, square)._replace(sigma=sigma)
    return shape


def _noise(model: Floats, shape: Shape) -> Floats:
    return shape.contrast**2 * model * model + model / shape.gain + shape.read_variance


def _total(values: Floats) -> Floats:
    total: Floats = np.maximum(values.sum(axis=1, keepdims=True), 1e-12)
    return total


def _better_sigma(
    sigma: float, distance: Floats, bell: Floats, model: Floats, residual: Floats, weight: Floats
) -> float:
    """One Gauss-Newton step of the common sigma, free of what a change of height does."""
    by_sigma = model * distance * distance / sigma**3
    share = (weight * by_sigma * bell).sum(axis=1, keepdims=True) / _total(weight * bell * bell)
    own = by_sigma - share * bell
    step = float((weight * residual * own).sum() / max(float((weight * own * own).sum()), 1e-12))
    return sigma + float(np.clip(step, -0.15 * sigma, 0.15 * sigma))


def _with_noise(shape: Shape, level: Floats, square: Floats) -> Shape:
    """The shape with the noise fitted to squared residuals (M,) at brightnesses (M,)."""
    order = np.argsort(level)
    edges = np.linspace(0, len(order), _BINS + 1).astype(np.intp)
    sizes = np.diff(edges)

    def class_mean(values: Floats) -> Floats:
        mean: Floats = np.add.reduceat(values[order], edges[:-1]) / sizes
        return mean

    terms = np.column_stack([class_mean(level * level), class_mean(level), np.ones(_BINS)])
    squares = class_mean(square)
    expected = np.maximum(squares, _LEAST_VARIANCE)
    found = np.zeros(3)
    for _ in range(2):
        # The mean of squares of variance v scatters in proportion to v.
        found, _ = nnls(terms / expected[:, None], squares / expected)
        expected = np.maximum(terms @ found, _LEAST_VARIANCE)
    return shape._replace(
        contrast=float(np.sqrt(min(found[0], 1.0))),
        gain=float(1.0 / max(found[1], 1e-3)),
        read_variance=float(max(found[2], _LEAST_VARIANCE)),
    )
