"""The sub-pixel centre of each peak, and what its fit leaves over, in NumPy."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.kernels.results import (
    CLASSES,
    FARTHEST,
    LEAST_FREE,
    SCORING_REACH,
    SCORING_ROUNDS,
    Leftovers,
    Refined,
    Shape,
    Windows,
)


def refine(windows: Windows, shape: Shape, is_scored: bool) -> tuple[Refined, Refined]:
    """Sub-pixel centres: zero crossing of the response to k exp(-k^2 / 2 sf^2), then Fisher scoring.

    Args:
        windows: at least `half_window` of the shape to either side.
        shape: what to look for.
        is_scored: whether the scoring step is wanted; without it the second answer is the first.

    Returns:
        The plain zero crossings, and those improved by scoring, line for line.
    """
    signal = windows.signal
    n, half = len(signal), signal.shape[1] // 2
    rows = np.arange(n)
    offsets = np.arange(-half, half + 1, dtype=np.float64)
    near = np.abs(offsets) <= 2.5 * shape.sigma
    positive = np.maximum(signal[:, near], 0.0)
    mass = positive.sum(axis=1)
    gravity = positive @ offsets[near] / np.maximum(mass, 1e-9)
    gravity = np.clip(gravity, -shape.search_radius, shape.search_radius)

    taps = np.arange(-shape.filter_radius, shape.filter_radius + 1, dtype=np.float64)
    kernel = taps * np.exp(-(taps**2) / (2.0 * shape.filter_sigma**2))
    spots = np.arange(-shape.search_radius, shape.search_radius + 1)
    bank = np.zeros((len(offsets), len(spots)))
    for index, spot in enumerate(spots):
        start = half + spot - shape.filter_radius
        bank[start : start + len(kernel), index] = kernel
    response = signal @ bank
    before, after = response[:, :-1], response[:, 1:]
    crosses = (before > 0.0) & (after <= 0.0)
    place = spots[:-1] + before / np.where(crosses, before - after, 1.0)
    distance = np.where(crosses, np.abs(place - gravity[:, None]), np.inf)
    best = np.argmin(distance, axis=1)
    is_found = np.isfinite(distance[rows, best])
    # The response falls off as a Gaussian away from the crossing; without it the line is straight.
    rate = 0.5 / (shape.sigma**2 + shape.filter_sigma**2)
    step = np.where(is_found, place[rows, best] - spots[best], 0.0)
    upper = before[rows, best] * np.exp(rate * step * step)
    lower = after[rows, best] * np.exp(rate * (1.0 - step) ** 2)
    x = np.where(is_found, spots[best] + upper / np.where(is_found, upper - lower, 1.0), 0.0)

    floor = shape.read_variance + windows.floor / shape.gain
    amplitude = _amplitude(windows, x, shape, offsets)
    is_found &= amplitude > 0.0
    variance = _crossing_variance(amplitude, floor, shape)
    width = _width(signal, x, shape)
    plain = _only_found(x, amplitude, width, variance, is_found)
    if not is_scored:
        return plain, plain
    scored = _score(signal, windows.usable, x, amplitude, floor, shape, offsets)
    fits = is_found & scored[3]
    improved = [np.where(fits, new, old) for new, old in zip(scored, (x, amplitude, variance), strict=False)]
    return plain, _only_found(improved[0], improved[1], width, improved[2], is_found)


def _only_found(
    x: Floats, amplitude: Floats, width: Floats, variance: Floats, is_found: NDArray[np.bool_]
) -> Refined:
    return Refined(
        np.where(is_found, x, 0.0),
        np.where(is_found, amplitude, 0.0),
        np.where(is_found, width, 0.0),
        np.where(is_found, variance, 0.0),
        is_found,
    )


def _bell(distance: Floats, sigma: float) -> Floats:
    bell: Floats = np.exp(-(distance**2) / (2.0 * sigma * sigma))
    return bell


def _amplitude(windows: Windows, x: Floats, shape: Shape, offsets: Floats) -> Floats:
    """Least-squares height of a bell at x, from pixels that are not clipped unless all of them are."""
    near = np.abs(offsets - x[:, None]) <= SCORING_REACH * shape.sigma
    bell = _bell(offsets - x[:, None], shape.sigma)
    inner = near & windows.usable
    g = np.where(inner.any(axis=1, keepdims=True), np.where(inner, bell, 0.0), np.where(near, bell, 0.0))
    energy = (g * g).sum(axis=1)
    amplitude: Floats = (g * windows.signal).sum(axis=1) / np.where(energy > 0.0, energy, 1.0)
    return amplitude


def _crossing_variance(amplitude: Floats, floor: Floats, shape: Shape) -> Floats:
    """Noise through the kernel over the slope of the response, squared; the sums over pixels as integrals."""
    s2, f2 = shape.sigma**2, shape.filter_sigma**2
    root = np.sqrt(2.0 * np.pi)
    speckle = (shape.contrast * amplitude) ** 2 * (2.0 / f2 + 2.0 / s2) ** -1.5
    shot = amplitude / shape.gain * (2.0 / f2 + 1.0 / s2) ** -1.5
    still = floor * (2.0 / f2) ** -1.5
    slope = amplitude * root * (1.0 / f2 + 1.0 / s2) ** -1.5 / s2
    variance: Floats = root * (speckle + shot + still) / np.where(amplitude > 0.0, slope * slope, 1.0)
    return variance


def _width(signal: Floats, x: Floats, shape: Shape) -> Floats:
    """Sigma from the second moment under a bell of known sigma, which keeps far noise out."""
    taps = np.arange(-shape.filter_radius, shape.filter_radius + 1, dtype=np.float64)
    start = signal.shape[1] // 2 + np.rint(x).astype(np.intp)
    under = np.take_along_axis(signal, start[:, None] + taps.astype(np.intp), axis=1) * _bell(
        taps, shape.filter_sigma
    )
    mass = under.sum(axis=1)
    safe = np.where(mass > 0.0, mass, 1.0)
    mean = under @ taps / safe
    spread = under @ (taps * taps) / safe - mean * mean
    bell = shape.filter_sigma**2
    # Two bells multiplied: 1 / spread = 1 / bell + 1 / sigma^2; a spread near the bell's own tells nothing.
    share = np.clip(spread / bell, 0.01, 0.95)
    return np.where(mass > 0.0, np.sqrt(bell * share / (1.0 - share)), 0.0)


def _score(
    signal: Floats,
    usable: NDArray[np.bool_],
    start: Floats,
    amplitude: Floats,
    floor: Floats,
    shape: Shape,
    offsets: Floats,
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """Fisher scoring of position and amplitude of a bell; its information gives the variance."""
    x, a = start, amplitude
    contrast2 = shape.contrast**2
    information = np.zeros(len(x))
    inner = usable & (np.abs(offsets - start[:, None]) <= SCORING_REACH * shape.sigma)
    for _ in range(SCORING_ROUNDS):
        distance = offsets - x[:, None]
        g = _bell(distance, shape.sigma)
        m = a[:, None] * g
        weight = np.where(inner, 1.0 / (contrast2 * m * m + m / shape.gain + floor[:, None]), 0.0)
        by_x = m * distance / shape.sigma**2
        residual = signal - m
        xx = (weight * by_x * by_x).sum(axis=1)
        xa = (weight * by_x * g).sum(axis=1)
        aa = (weight * g * g).sum(axis=1)
        bx = (weight * by_x * residual).sum(axis=1)
        ba = (weight * g * residual).sum(axis=1)
        determinant = xx * aa - xa * xa
        sound = determinant > 1e-9 * xx * aa
        safe = np.where(sound, determinant, 1.0)
        information = np.where(sound, determinant / np.where(aa > 0.0, aa, 1.0), 0.0)
        dx = np.where(sound, (aa * bx - xa * ba) / safe, 0.0)
        da = np.where(sound, (xx * ba - xa * bx) / safe, 0.0)
        x = x + np.clip(dx, -0.5 * shape.sigma, 0.5 * shape.sigma)
        a = np.clip(a + da, 0.5 * a, 2.0 * a)
    fits = (information > 0.0) & (np.abs(x - start) <= FARTHEST * shape.sigma)
    return x, a, 1.0 / np.where(information > 0.0, information, 1.0), fits


def misfits(windows: Windows, fit: Refined, shape: Shape) -> Floats:
    """How far (N,) windows are from the plain bell of a fit: squared residuals over the squared amplitude."""
    half = windows.signal.shape[1] // 2
    distance = np.arange(-half, half + 1) - fit.offset[:, None]
    model = fit.amplitude[:, None] * _bell(distance, shape.sigma)
    inside = windows.usable & (np.abs(distance) <= SCORING_REACH * shape.sigma)
    misfit: Floats = np.where(inside, (windows.signal - model) ** 2, 0.0).sum(axis=1)
    misfit /= np.maximum(fit.amplitude, 1.0) ** 2
    return misfit


def leftovers(windows: Windows, fit: Refined, shape: Shape) -> Leftovers:
    """What a scored fit leaves over in its windows."""
    half = windows.signal.shape[1] // 2
    distance = np.arange(-half, half + 1) - fit.offset[:, None]
    inside = windows.usable & fit.is_found[:, None] & (np.abs(distance) <= SCORING_REACH * shape.sigma)
    if not inside.any():
        return Leftovers(np.zeros((CLASSES, 3)), np.zeros(CLASSES), 0, 0.0)
    bell = _bell(distance, shape.sigma)
    model = fit.amplitude[:, None] * bell
    residual = windows.signal - model
    variance = shape.contrast**2 * model * model + model / shape.gain + shape.read_variance
    weight = np.where(inside, 1.0 / variance, 0.0)
    by_height, by_place = weight * bell * bell, weight * (bell * distance) ** 2
    heights = by_height.sum(axis=1, keepdims=True)
    taken = by_height / np.maximum(heights, 1e-12)
    taken += by_place / np.maximum(by_place.sum(axis=1, keepdims=True), 1e-12)

    level = model[inside]
    square = residual[inside] ** 2 / np.maximum(1.0 - taken[inside], LEAST_FREE)
    top = float(fit.amplitude.max())
    number = np.minimum((CLASSES * np.sqrt(level / top)).astype(np.intp), CLASSES - 1)
    count = np.bincount(number, minlength=CLASSES)
    many = np.maximum(count, 1)
    terms = [np.bincount(number, values, CLASSES) / many for values in (level * level, level)]
    squares = np.bincount(number, square, CLASSES) / many

    # One Gauss-Newton step of the common sigma, free of what a change of height does.
    by_sigma = model * distance * distance
    share = (weight * by_sigma * bell).sum(axis=1, keepdims=True) / np.maximum(heights, 1e-12)
    own = by_sigma - share * bell
    step = float((weight * residual * own).sum() / max(float((weight * own * own).sum()), 1e-12))
    terms.append((count > 0).astype(np.float64))
    return Leftovers(np.column_stack(terms), squares, int(inside.sum()), step * shape.sigma**2)
