"""The stripe's width and the camera's noise, told by the picture itself."""

import math

import numpy as np
from numpy.typing import NDArray

from app.vision.kernels import Kernels
from app.vision.kernels.results import Shape, Windows

_LINES = 72
_FEW = 40
_MISFIT_LIMIT = 6.0
_ROUNDS = 3
_LEAST_PIXELS = 300
# Hardly more than rounding to whole grey levels brings into two pictures.
_LEAST_VARIANCE = 0.25
# Residuals above it are not speckle: the stripe has another shape than a bell.
LARGEST_CONTRAST = 0.5


def measured_shape(
    windows: Windows, steady: NDArray[np.bool_], shape: Shape, kernels: Kernels, is_sigma_known: bool
) -> Shape:
    """The shape with stripe sigma, speckle contrast, gain and read noise as this picture has them.

    A sample of the lines is fitted, and what is left over speaks. The squared residual at a place of
    brightness m is C^2 m^2 + m / K + v0 on average, less the share that the fit of position and height has
    taken up; the three terms, none below zero, are fitted to the means of brightness classes. The residual's
    share along dm/dsigma corrects the sigma that all lines have in common. Then the fit is repeated.

    Args:
        windows: with nothing in `floor`, so that the background's noise is part of the answer.
        steady: (N,) which of them are stripe beyond doubt; where these are few, all are taken.
        shape: start; returned as it is where the picture has too few lines.
        kernels: that fit.
        is_sigma_known: leaves the sigma alone.
    """
    lines = np.flatnonzero(steady)
    if len(lines) < _FEW:
        lines = np.arange(len(steady))
    sample = windows.select(lines[:: max(1, len(lines) // _LINES)])
    sample = sample.select(_well_fitted(sample, shape, kernels))
    for _ in range(_ROUNDS):
        _, fit = kernels.refine(sample, shape, True)
        rest = kernels.leftovers(sample, fit, shape)
        if rest.pixels < _LEAST_PIXELS:
            return shape
        contrast2, per_gain, floor = kernels.noise_terms(rest.terms, rest.squares, _LEAST_VARIANCE)
        step = 0.0 if is_sigma_known else min(max(rest.sigma_step, -0.15), 0.15) * shape.sigma
        shape = shape._replace(
            sigma=shape.sigma + step,
            contrast=min(math.sqrt(contrast2), LARGEST_CONTRAST),
            gain=float(1.0 / max(per_gain, 1e-3)),
            read_variance=float(max(floor, _LEAST_VARIANCE)),
        )
    return shape


def _well_fitted(sample: Windows, shape: Shape, kernels: Kernels) -> NDArray[np.intp]:
    """Lines that look like most others: clutter that is as bright as a stripe has another shape."""
    fit, _ = kernels.refine(sample, shape, False)
    misfit = kernels.misfits(sample, fit, shape)
    known = misfit[fit.is_found]
    if len(known) == 0:
        return np.zeros(0, np.intp)
    # The lower quartile, since the better half of a picture may be the smaller one.
    limit = _MISFIT_LIMIT * float(np.partition(known, len(known) // 4)[len(known) // 4])
    return np.flatnonzero(fit.is_found & (misfit <= limit))
