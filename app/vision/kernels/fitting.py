"""Loops that find the sub-pixel centre of each peak. Constants come as arguments, as in `searching`."""

import numpy as np

from app.vision.kernels.jit import compiled_loosely as compiled
from app.vision.kernels.jit import inlined_loosely as inlined


@compiled
def refine(signal, usable, floor, widths, reaches, noise, rounds, plain, scored, is_found):
    """plain, scored: (4, N) offset, amplitude, width, variance, zero to begin with; rounds: of scoring.

    What the inner loops read is laid out beside each other and filled up to whole vectors: a tail shorter
    than a vector would cost as much as all the rest.
    """
    sigma, filter_sigma = widths
    radius, reach, scoring_reach, farthest = reaches
    size = signal.shape[1]
    half = size // 2
    taps = _whole_vectors(2 * radius + 1)
    kernel, bell = np.zeros(taps), np.zeros(taps)
    for k in range(-radius, radius + 1):
        bell[k + radius] = np.exp(-(k * k) / (2.0 * filter_sigma**2))
        kernel[k + radius] = k * bell[k + radius]
    speckle, shot, still = _variance_terms(sigma, filter_sigma, noise)
    values = np.zeros(size + taps)
    near = np.zeros((4, _whole_vectors(size)))
    for n in range(len(signal)):
        for k in range(size):
            values[k] = signal[n, k]
        x, is_crossing = _crossing(values, half, kernel, radius, reach, sigma, filter_sigma)
        if not is_crossing:
            continue
        first, inside, many = _lay_out(values, usable, n, size, x, scoring_reach * sigma, near)
        _bell_at(near, first - half - x, sigma, many)
        a = _amplitude(near, inside, many)
        if a <= 0.0:
            continue
        is_found[n] = True
        width = _width(values, half, x, filter_sigma, bell, radius)
        variance = speckle + shot / a + still * (noise[2] + floor[n] / noise[1]) / (a * a)
        plain[0, n], plain[1, n], plain[2, n], plain[3, n] = x, a, width, variance
        if rounds > 0:
            x, a, variance = _score(
                near, many, first - half, x, a, variance, floor[n], sigma, farthest * sigma, noise, rounds
            )
            scored[0, n], scored[1, n], scored[2, n], scored[3, n] = x, a, width, variance


@inlined
def _whole_vectors(count):
    return (count + 15) // 16 * 16


@inlined
def _crossing(values, half, kernel, radius, reach, sigma, filter_sigma):
    """The crossing nearest to the centre of gravity, looked for from there outwards."""
    near = min(int(np.floor(2.5 * sigma)), half)
    mass = moment = 0.0
    for k in range(-near, near + 1):
        value = max(values[half + k], 0.0)
        mass += value
        moment += value * k
    gravity = min(max(moment / max(mass, 1e-9), -float(reach)), float(reach))
    middle = min(max(int(np.floor(gravity)), -reach), reach - 1)
    best, before_best, after_best, spot_best = np.inf, 0.0, 0.0, 0
    left = _response(values, half + middle - radius, kernel)
    right = _response(values, half + middle + 1 - radius, kernel)
    if left > 0.0 and right <= 0.0:
        best, before_best, after_best, spot_best = 0.0, left, right, middle
    for ring in range(1, 2 * reach):
        if best <= ring - 1.0:
            break
        spot = middle - ring
        if spot >= -reach:
            value = _response(values, half + spot - radius, kernel)
            if value > 0.0 and left <= 0.0:
                distance = abs(spot + value / (value - left) - gravity)
                if distance < best:
                    best, before_best, after_best, spot_best = distance, value, left, spot
            left = value
        spot = middle + ring
        if spot < reach:
            value = _response(values, half + spot + 1 - radius, kernel)
            if right > 0.0 and value <= 0.0:
                distance = abs(spot + right / (right - value) - gravity)
                if distance < best:
                    best, before_best, after_best, spot_best = distance, right, value, spot
            right = value
    if best == np.inf:
        return 0.0, False
    rate = 0.5 / (sigma * sigma + filter_sigma * filter_sigma)
    step = before_best / (before_best - after_best)
    upper = before_best * np.exp(rate * step * step)
    lower = after_best * np.exp(rate * (1.0 - step) ** 2)
    return spot_best + upper / (upper - lower), True


@inlined
def _response(values, start, kernel):
    total = 0.0
    begin = np.uint64(start)
    for k in range(np.uint64(len(kernel))):
        total += values[begin + k] * kernel[k]
    return total


@inlined
def _lay_out(values, usable, n, size, x, limit, near):
    """The pixels within the limit, in `near`: signal, whether it is usable, room for the bell, place.

    Returns the first one, how many there are, and how many with those of no use that fill the last vector.
    """
    half = size // 2
    first = max(0, int(np.ceil(half + x - limit)))
    last = min(size - 1, int(np.floor(half + x + limit)))
    many = _whole_vectors(last + 1 - first)
    for k in range(many):
        is_near = first + k <= last
        near[0, k] = values[first + k] if is_near else 0.0
        near[1, k] = 1.0 if is_near and usable[n, first + k] else 0.0
        near[3, k] = k
    return first, last + 1 - first, many


@inlined
def _bell_at(near, start, sigma, many):
    """near[2] = exp(-d^2 / 2 sigma^2) at d = start + k: each by what the one before tells."""
    scale = 0.5 / (sigma * sigma)
    value = np.exp(-start * start * scale)
    ratio, bend = np.exp(-(2.0 * start + 1.0) * scale), np.exp(-2.0 * scale)
    for k in range(many):
        near[2, k] = value
        value *= ratio
        ratio *= bend


@inlined
def _amplitude(near, inside, many):
    energy = total = 0.0
    for k in range(np.uint64(many)):
        g = near[2, k] * near[1, k]
        energy += g * g
        total += g * near[0, k]
    if energy == 0.0:
        for k in range(inside):
            energy += near[2, k] * near[2, k]
            total += near[2, k] * near[0, k]
    return total / energy if energy > 0.0 else 0.0


@inlined
def _variance_terms(sigma, filter_sigma, noise):
    """What a point's variance is made of: of speckle, of shot noise times a, of still noise times a^2."""
    contrast, gain, _ = noise
    s2, f2 = sigma * sigma, filter_sigma * filter_sigma
    squares = 2.0 / f2
    slope = np.sqrt(2.0 * np.pi) * (1.0 / f2 + 1.0 / s2) ** -1.5 / s2
    scale = np.sqrt(2.0 * np.pi) / (slope * slope)
    return (
        scale * contrast * contrast * (squares + 2.0 / s2) ** -1.5,
        scale / gain * (squares + 1.0 / s2) ** -1.5,
        scale * squares**-1.5,
    )


@inlined
def _width(values, half, x, filter_sigma, bell, radius):
    begin = np.uint64(half + int(np.rint(x)) - radius)
    mass = moment = square = place = 0.0
    for k in range(np.uint64(len(bell))):
        under = values[begin + k] * bell[k]
        mass += under
        moment += under * place
        square += under * place * place
        place += 1.0
    if mass <= 0.0:
        return 0.0
    mean = moment / mass
    widest = filter_sigma * filter_sigma
    share = min(max((square / mass - mean * mean) / widest, 0.01), 0.95)
    return np.sqrt(widest * share / (1.0 - share))


@inlined
def _score(near, many, start, x_start, amplitude, variance, floor, sigma, farthest, noise, rounds):
    """start: of the pixels laid out, from the middle of the window; x_start: what the scoring starts from."""
    contrast, gain, read_variance = noise
    contrast2, per_gain, still = contrast * contrast, 1.0 / gain, read_variance + floor / gain
    x, a = x_start, amplitude
    per_s2 = 1.0 / (sigma * sigma)
    information = 0.0
    for number in range(rounds):
        if number > 0:
            _bell_at(near, start - x, sigma, many)
        xx = xa = aa = bx = ba = 0.0
        distance = start - x
        for k in range(np.uint64(many)):
            g = near[2, k]
            m = a * g
            by_x = m * (near[3, k] + distance) * per_s2
            weight = 1.0 / (contrast2 * m * m + m * per_gain + still)
            weight = weight if near[1, k] > 0.0 else 0.0
            residual = near[0, k] - m
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
    if information > 0.0 and abs(x - x_start) <= farthest:
        return x, a, 1.0 / information
    return x_start, amplitude, variance


@compiled
def misfits(signal, usable, offset, amplitude, sigma, reach):
    """Sum (N,) of squared residuals over the squared amplitude."""
    half = signal.shape[1] // 2
    near = np.zeros((4, _whole_vectors(signal.shape[1])))
    misfit = np.empty(len(signal))
    for n in range(len(signal)):
        x, a = offset[n], amplitude[n]
        first, _, many = _lay_out(signal[n], usable, n, signal.shape[1], x, reach, near)
        _bell_at(near, first - half - x, sigma, many)
        total = 0.0
        for k in range(np.uint64(many)):
            residual = near[1, k] * (near[0, k] - a * near[2, k])
            total += residual * residual
        misfit[n] = total / max(a, 1.0) ** 2
    return misfit


@compiled
def leftovers(signal, usable, offset, amplitude, is_found, sigma, reach, noise, least_free, terms, squares):
    """terms: (CLASSES, 3), squares: (CLASSES,), zeros to begin with. Returns pixels and the step of sigma."""
    contrast, gain, read_variance = noise
    contrast2, per_gain = contrast * contrast, 1.0 / gain
    classes = len(squares)
    half = signal.shape[1] // 2
    near = np.zeros((4, _whole_vectors(signal.shape[1])))
    told = np.zeros((4, near.shape[1]))
    top = 0.0
    for n in range(len(signal)):
        top = max(top, amplitude[n])
    pixels = 0
    along = across = 0.0
    for n in range(len(signal)):
        if not is_found[n]:
            continue
        x, a = offset[n], amplitude[n]
        first, _, many = _lay_out(signal[n], usable, n, signal.shape[1], x, reach, near)
        start = first - half - x
        _bell_at(near, start, sigma, many)
        heights = places = sigmas = 0.0
        for k in range(np.uint64(many)):
            g, d = near[2, k], near[3, k] + start
            m = a * g
            weight = 1.0 / (contrast2 * m * m + m * per_gain + read_variance)
            weight = weight if near[1, k] > 0.0 else 0.0
            by_height, square = weight * g * g, d * d
            heights += by_height
            places += by_height * square
            sigmas += a * by_height * square
            told[0, k] = weight * g
            told[1, k] = square
        heights, places = max(heights, 1e-12), max(places, 1e-12)
        share = sigmas / heights
        for k in range(np.uint64(many)):
            g, square = near[2, k], told[1, k]
            m, by_height = a * g, told[0, k] * g
            residual = near[0, k] - m
            free = max(1.0 - by_height / heights - by_height * square / places, least_free)
            told[2, k] = residual * residual / free
            told[3, k] = classes * np.sqrt(m / top)
            own = a * square - share
            along += told[0, k] * residual * own
            across += by_height * own * own
        for k in range(many):
            if near[1, k] > 0.0:
                m = a * near[2, k]
                number = min(int(told[3, k]), classes - 1)
                terms[number, 0] += m * m
                terms[number, 1] += m
                terms[number, 2] += 1.0
                squares[number] += told[2, k]
                pixels += 1
    for number in range(classes):
        many = terms[number, 2]
        if many > 0.0:
            terms[number, 0] /= many
            terms[number, 1] /= many
            terms[number, 2] = 1.0
            squares[number] /= many
    return pixels, along / max(across, 1e-12) * sigma * sigma
