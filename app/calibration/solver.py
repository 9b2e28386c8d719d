"""Levenberg-Marquardt on the bundle's normal equations, robust, with the noise of each group estimated."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from app.calibration.bundle import Corners, State, Stripes, moved, residuals
from app.calibration.correlation import correlation_of_groups
from app.errors import CalibrationError
from app.geometry.arrays import Floats

_STEPS = 60
_CONVERGED = 1e-7
# Beyond three standard deviations a residual counts ever less (Huber's threshold, smooth form).
_ROBUST_SCALE = 3.0
_MAD_TO_SIGMA = 1.4826
_NOISE_ROUNDS = 3
# Skew light across a wide stripe moves it as a whole; simulated pictures show 0.01 to 0.05 px.
_STRIPE_SHIFT_PX = 0.03


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """What the adjustment found.

    Attributes:
        state: the unknowns.
        uncertain: (U,) columns of the parameter vector that have a covariance; the others were held.
        covariance: (U, U) of those, scaled to the noise that was seen and to how far neighbours and
            whole stripes err together.
        corner_residuals: (Nc, 2) px.
        stripe_residuals: (Ns,) px across the stripe.
        noise: for each group, the noise seen relative to the noise assumed.
        chi: RMS of the residuals in units of their ASSUMED standard deviation, per degree of freedom.
    """

    state: State
    uncertain: NDArray[np.intp]
    covariance: Floats
    corner_residuals: Floats
    stripe_residuals: Floats
    noise: Floats
    chi: float

    def covariance_of(self, columns: NDArray[np.intp]) -> Floats:
        """(K, K) covariance of columns of the parameter vector; zero for those held fixed."""
        place = np.full(int(max(self.uncertain.max(), columns.max())) + 1, -1)
        place[self.uncertain] = np.arange(len(self.uncertain))
        at = place[columns]
        known = at >= 0
        out = np.zeros((len(columns), len(columns)))
        out[np.ix_(known, known)] = self.covariance[np.ix_(at[known], at[known])]
        return out


def solve(
    state: State,
    corners: Corners,
    stripes: Stripes,
    free: NDArray[np.intp],
    on_step: Callable[[int, float], None] = lambda step, cost: None,
    uncertain: NDArray[np.intp] | None = None,
) -> Solution:
    """Minimise the robust sum of squares over the free columns.

    Args:
        free: (F,) columns that may change.
        uncertain: (U,) columns that the covariance is about, where these are more than the free ones.
        on_step: told the number of the step and the cost.

    Raises:
        CalibrationError: the views leave an unknown undetermined.
    """
    n_groups = 1 + int(max(corners.group.max(initial=0), stripes.group.max(initial=0)))
    noise = np.ones(n_groups)
    step = 0
    for _ in range(_NOISE_ROUNDS):
        scaled_corners = replace(corners, sigma=corners.sigma * noise[corners.group])
        scaled_stripes = replace(stripes, sigma=stripes.sigma * noise[stripes.group])
        state, step = _descend(state, scaled_corners, scaled_stripes, free, step, on_step)
        r, _ = residuals(state, scaled_corners, scaled_stripes)
        noise = noise * _noise_of_groups(r, corners, stripes)
    # Neighbours that err together tell less than their number says.
    r, _ = residuals(
        state,
        replace(corners, sigma=corners.sigma * noise[corners.group]),
        replace(stripes, sigma=stripes.sigma * noise[stripes.group]),
    )
    trusted = noise * np.sqrt(correlation_of_groups(r, corners, stripes))
    scaled_corners = replace(corners, sigma=corners.sigma * trusted[corners.group])
    scaled_stripes = replace(stripes, sigma=stripes.sigma * trusted[stripes.group])
    state, _ = _descend(state, scaled_corners, scaled_stripes, free, step, on_step)
    r, jacobian = residuals(state, scaled_corners, scaled_stripes)
    uncertain = free if uncertain is None else uncertain
    normal = _normal_matrix(jacobian[:, uncertain], _weights(r))
    covariance = _covariance(np.asarray(normal.toarray(), np.float64))
    n = 2 * len(corners.pixels)
    covariance += _by_shifted_stripes(covariance, jacobian[n:, uncertain], _weights(r)[n:], scaled_stripes)
    assumed = _in_assumed_units(r, trusted, corners, stripes)
    is_inlier = np.abs(r) < 2.0 * _ROBUST_SCALE
    freedom = max(int(is_inlier.sum()) - len(free), 1)
    return Solution(
        state,
        uncertain,
        covariance,
        r[:n].reshape(-1, 2) * scaled_corners.sigma[:, None],
        r[n:] * scaled_stripes.sigma,
        noise,
        float(np.sqrt(np.sum(assumed[is_inlier] ** 2) / freedom)),
    )


def _weights(r: Floats) -> Floats:
    weights: Floats = 1.0 / np.sqrt(1.0 + (r / _ROBUST_SCALE) ** 2)
    return weights


def _cost(r: Floats) -> float:
    """Whose derivative the weights are: the pseudo-Huber loss."""
    return float(2.0 * _ROBUST_SCALE**2 * np.sum(np.sqrt(1.0 + (r / _ROBUST_SCALE) ** 2) - 1.0))


def _normal_matrix(jacobian: sparse.csr_array, weights: Floats) -> sparse.csc_array:
    weighted = sparse.csr_array(sparse.diags_array(np.sqrt(weights)) @ jacobian)
    return sparse.csc_array(weighted.T @ weighted)


def _descend(
    state: State,
    corners: Corners,
    stripes: Stripes,
    free: NDArray[np.intp],
    step: int,
    on_step: Callable[[int, float], None],
) -> tuple[State, int]:
    damping = 1e-4
    r, jacobian = residuals(state, corners, stripes)
    cost = _cost(r)
    total = jacobian.shape[1]
    for _ in range(_STEPS):
        weights = _weights(r)
        reduced = jacobian[:, free]
        normal = _normal_matrix(reduced, weights)
        gradient = reduced.T @ (weights * r)
        improvement = 0.0
        for _ in range(12):
            delta = np.zeros(total)
            delta[free] = -_solve_damped(normal, gradient, damping)
            candidate = moved(state, delta)
            r_new, jacobian_new = residuals(candidate, corners, stripes)
            cost_new = _cost(r_new) if np.isfinite(r_new).all() else np.inf
            if cost_new <= cost:
                improvement = cost - cost_new
                state, r, jacobian, cost = candidate, r_new, jacobian_new, cost_new
                damping = max(damping / 10.0, 1e-12)
                break
            damping *= 10.0
        step += 1
        on_step(step, cost)
        if improvement <= _CONVERGED * max(cost, 1e-12):
            break
    return state, step


def _solve_damped(normal: sparse.csc_array, gradient: Floats, damping: float) -> Floats:
    diagonal = normal.diagonal()
    if not np.isfinite(diagonal).all():
        raise CalibrationError("The adjustment ran away: the start values do not fit the pictures.")
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-300)))
    scaling = sparse.diags_array(scale)
    damped = scaling @ normal @ scaling + (damping + 1e-14) * sparse.eye_array(len(scale))
    # Bodies and angles meet only through camera, axis and planes: the factor stays sparse.
    factor = linalg.splu(
        sparse.csc_array(damped), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )
    solved: Floats = scale * factor.solve(scale * gradient)
    return solved


def _covariance(normal: Floats) -> Floats:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale[None, :]
    values, vectors = np.linalg.eigh(scaled)
    if values[0] <= 1e-13 * values[-1]:
        raise CalibrationError(
            "The pictures do not determine the rig: one combination of its unknowns can change freely."
        )
    inverse = (vectors / values) @ vectors.T
    covariance: Floats = inverse * scale[:, None] * scale[None, :]
    return covariance


def _by_shifted_stripes(
    covariance: Floats, jacobian: sparse.csr_array, weights: Floats, stripes: Stripes
) -> Floats:
    """What it adds to the covariance that a stripe may be shifted as a whole, which no average shows."""
    if not len(weights):
        return np.zeros_like(covariance)
    keys = np.column_stack([stripes.body, stripes.angle, stripes.laser])
    _, stripe = np.unique(keys, axis=0, return_inverse=True)
    pull = sparse.csr_array(
        (_STRIPE_SHIFT_PX * weights / stripes.sigma, (np.arange(len(weights)), stripe.ravel()))
    )
    moved_by = covariance @ np.asarray((jacobian.T @ pull).toarray(), np.float64)
    added: Floats = moved_by @ moved_by.T
    return added


def _noise_of_groups(r: Floats, corners: Corners, stripes: Stripes) -> Floats:
    """Robust RMS of each group's normalised residuals; one where a group is small."""
    group = np.concatenate([np.repeat(corners.group, 2), stripes.group])
    noise = np.ones(int(group.max(initial=0)) + 1)
    for number in range(len(noise)):
        mine = np.abs(r[group == number])
        if len(mine) >= 20:
            core = mine[mine < 4.0 * _MAD_TO_SIGMA * np.median(mine)]
            noise[number] = max(float(np.sqrt(np.mean(core**2))), 1e-3)
    return noise


def _in_assumed_units(r: Floats, noise: Floats, corners: Corners, stripes: Stripes) -> Floats:
    group = np.concatenate([np.repeat(corners.group, 2), stripes.group])
    assumed: Floats = r * noise[group]
    return assumed
