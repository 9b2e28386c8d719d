"""Loops that find the sub-pixel centre of each peak."""

import numpy as np

from app.vision.kernels.jit import compiled
from app.vision.kernels.results import AMPLITUDE_REACH, SCORING_REACH, SCORING_ROUNDS


@compiled
def refine(signal, usable, floor, sigma, filter_sigma, radius, reach, contrast, gain, read_variance, is_scored, plain, scored, is_found):  # type: ignore[no-untyped-def] # fmt: skip
    """plain, scored: (4, N) offset, amplitude, width, variance, zero to begin with."""
    half = signal.shape[1] // 2
    kernel = np.empty(2 * radius + 1)
    for k in range(-radius, radius + 1):
        kernel[k + radius] = k * np.exp(-(k * k) / (2.0 * filter_sigma**2))
    bell = np.empty(signal.shape[1])
    for n in range(len(signal)):
        row = signal[n]
        x, is_crossing = _crossing(row, half, kernel, radius, reach, sigma, filter_sigma)
        if not is_crossing:
            continue
        noise = read_variance + floor[n] / gain
        a = _amplitude(row, usable[n], half, x, sigma, bell)
        if a <= 0.0:
            continue
        is_found[n] = True
        variance = _crossing_variance(x, a, noise, kernel, radius, sigma, contrast, gain, bell)
        width = _width(row, half, x, filter_sigma, bell)
        plain[0, n], plain[1, n], plain[2, n], plain[3, n] = x, a, width, variance
        if is_scored:
            x, a, variance = _score(row, usable[n], half, x, a, variance, noise, sigma, contrast, gain, bell)
            scored[0, n], scored[1, n], scored[2, n], scored[3, n] = x, a, width, variance


@compiled
def _fill_bell(bell, count, start, sigma):  # type: ignore[no-untyped-def]
    """exp(-d^2 / 2 sigma^2) for d = start, start + 1, ...: each value from the one before."""
    scale = 0.5 / (sigma * sigma)
    value = np.exp(-start * start * scale)
    ratio = np.exp(-(2.0 * start + 1.0) * scale)
    bend = np.exp(-2.0 * scale)
    for k in range(count):
        bell[k] = value
        value *= ratio
        ratio *= bend


@compiled
def _crossing(row, half, kernel, radius, reach, sigma, filter_sigma):  # type: ignore[no-untyped-def]
    near = int(np.floor(2.5 * sigma))
    mass = moment = 0.0
    for k in range(-min(near, half), min(near, half) + 1):
        value = max(row[half + k], 0.0)
        mass += value
        moment += value * k
    gravity = min(max(moment / max(mass, 1e-9), -float(reach)), float(reach))
    best, before_best, after_best, spot_best = np.inf, 0.0, 0.0, 0
    before = _response(row, half - reach, kernel, radius)
    for spot in range(-reach, reach):
        after = _response(row, half + spot + 1, kernel, radius)
        if before > 0.0 and after <= 0.0:
            distance = abs(spot + before / (before - after) - gravity)
            if distance < best:
                best, before_best, after_best, spot_best = distance, before, after, spot
        before = after
    if best == np.inf:
        return 0.0, False
    rate = 0.5 / (sigma * sigma + filter_sigma * filter_sigma)
    step = before_best / (before_best - after_best)
    upper = before_best * np.exp(rate * step * step)
    lower = after_best * np.exp(rate * (1.0 - step) ** 2)
    return spot_best + upper / (upper - lower), True


@compiled
def _response(row, middle, kernel, radius):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(2 * radius + 1):
        total += row[middle - radius + k] * kernel[k]
    return total


@compiled
def _amplitude(row, usable, half, x, sigma, bell):  # type: ignore[no-untyped-def]
    count = len(row)
    _fill_bell(bell, count, -half - x, sigma)
    limit = AMPLITUDE_REACH * sigma
    energy = total = 0.0
    for k in range(count):
        if usable[k] and abs(k - half - x) <= limit:
            energy += bell[k] * bell[k]
            total += bell[k] * row[k]
    return total / energy if energy > 0.0 else 0.0


@compiled
def _crossing_variance(x, a, noise, kernel, radius, sigma, contrast, gain, bell):  # type: ignore[no-untyped-def]
    shift = np.rint(x) - x
    through = slope = 0.0
    scale = 0.5 / (sigma * sigma)
    value = np.exp(-((shift - radius) ** 2) * scale)
    ratio = np.exp(-(2.0 * (shift - radius) + 1.0) * scale)
    bend = np.exp(-2.0 * scale)
    for k in range(2 * radius + 1):
        m = a * value
        h = kernel[k]
        through += (contrast * contrast * m * m + m / gain + noise) * h * h
        slope += m * (k - radius + shift) * h
        value *= ratio
        ratio *= bend
    slope /= sigma * sigma
    return through / max(slope * slope, 1e-12)


@compiled
def _width(row, half, x, filter_sigma, bell):  # type: ignore[no-untyped-def]
    count = len(row)
    _fill_bell(bell, count, -half - x, filter_sigma)
    mass = moment = 0.0
    for k in range(count):
        under = row[k] * bell[k]
        mass += under
        moment += under * (k - half - x) ** 2
    if mass <= 0.0:
        return 0.0
    widest = filter_sigma * filter_sigma
    share = min(max(moment / mass / widest, 0.01), 0.95)
    return np.sqrt(widest * share / (1.0 - share))


@compiled
def _score(row, usable, half, start, amplitude, variance, noise, sigma, contrast, gain, bell):  # type: ignore[no-untyped-def]
    x, a = start, amplitude
    limit = SCORING_REACH * sigma
    first = max(0, int(np.ceil(half + start - limit)))
    last = min(len(row) - 1, int(np.floor(half + start + limit)))
    information = 0.0
    for _ in range(SCORING_ROUNDS):
        _fill_bell(bell, last - first + 1, first - half - x, sigma)
        xx = xa = aa = bx = ba = 0.0
        for k in range(first, last + 1):
            if not usable[k]:
                continue
            g = bell[k - first]
            m = a * g
            weight = 1.0 / (contrast * contrast * m * m + m / gain + noise)
            by_x = m * (k - half - x) / (sigma * sigma)
            residual = row[k] - m
            xx += weight * by_x * by_x
            xa += weight * by_x * g
            aa += weight * g * g
            bx += weight * by_x * residual
            ba += weight * g * residual
        determinant = xx * aa - xa * xa
        if determinant <= 1e-9 * xx * aa:
            information = 0.0
            break
        information = determinant / aa
        dx = (aa * bx - xa * ba) / determinant
        da = (xx * ba - xa * bx) / determinant
        x += min(max(dx, -0.5 * sigma), 0.5 * sigma)
        a = min(max(a + da, 0.5 * a), 2.0 * a)
    if information > 0.0 and abs(x - start) <= sigma:
        return x, a, 1.0 / information
    return start, amplitude, variance
