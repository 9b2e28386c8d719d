"""Loops that find the sub-pixel centre of each peak. Constants come as arguments, as in `searching`."""

import numpy as np

from app.vision.kernels.jit import compiled_loosely as compiled


@compiled
def refine(signal, usable, floor, widths, reaches, noise, rounds, plain, scored, is_found):
    """plain, scored: (4, N) offset, amplitude, width, variance, zero to begin with; rounds: of scoring."""
    sigma, filter_sigma = widths
    radius, reach, scoring_reach, farthest = reaches
    half = signal.shape[1] // 2
    kernel, bell = np.empty(2 * radius + 1), np.empty(2 * radius + 1)
    for k in range(-radius, radius + 1):
        bell[k + radius] = np.exp(-(k * k) / (2.0 * filter_sigma**2))
        kernel[k + radius] = k * bell[k + radius]
    speckle, shot, still = _variance_terms(sigma, filter_sigma, noise)
    for n in range(len(signal)):
        x, is_crossing = _crossing(signal, n, half, kernel, radius, reach, sigma, filter_sigma)
        if not is_crossing:
            continue
        a = _amplitude(signal, usable, n, half, x, sigma, scoring_reach * sigma)
        if a <= 0.0:
            continue
        is_found[n] = True
        width = _width(signal, n, half, x, filter_sigma, bell, radius)
        variance = speckle + shot / a + still * (noise[2] + floor[n] / noise[1]) / (a * a)
        plain[0, n], plain[1, n], plain[2, n], plain[3, n] = x, a, width, variance
        if rounds > 0:
            x, a, variance = _score(
                signal,
                usable,
                n,
                half,
                x,
                a,
                variance,
                floor[n],
                sigma,
                scoring_reach * sigma,
                farthest * sigma,
                noise,
                rounds,
            )
            scored[0, n], scored[1, n], scored[2, n], scored[3, n] = x, a, width, variance


@compiled
def _crossing(signal, n, half, kernel, radius, reach, sigma, filter_sigma):
    """The crossing nearest to the centre of gravity, looked for from there outwards."""
    near = min(int(np.floor(2.5 * sigma)), half)
    mass = moment = 0.0
    for k in range(-near, near + 1):
        value = max(signal[n, half + k], 0.0)
        mass += value
        moment += value * k
    gravity = min(max(moment / max(mass, 1e-9), -float(reach)), float(reach))
    middle = min(max(int(np.floor(gravity)), -reach), reach - 1)
    best, before_best, after_best, spot_best = np.inf, 0.0, 0.0, 0
    left = _response(signal, n, half + middle, kernel, radius)
    right = _response(signal, n, half + middle + 1, kernel, radius)
    if left > 0.0 and right <= 0.0:
        best, before_best, after_best, spot_best = 0.0, left, right, middle
    for ring in range(1, 2 * reach):
        if best < ring - 1.0:
            break
        spot = middle - ring
        if spot >= -reach:
            value = _response(signal, n, half + spot, kernel, radius)
            if value > 0.0 and left <= 0.0:
                distance = abs(spot + value / (value - left) - gravity)
                if distance < best:
                    best, before_best, after_best, spot_best = distance, value, left, spot
            left = value
        spot = middle + ring
        if spot < reach:
            value = _response(signal, n, half + spot + 1, kernel, radius)
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


@compiled
def _response(signal, n, middle, kernel, radius):
    total = 0.0
    row, start = np.uint64(n), np.uint64(middle - radius)
    for k in range(np.uint64(2 * radius + 1)):
        total += signal[row, start + k] * kernel[k]
    return total


@compiled
def _amplitude(signal, usable, n, half, x, sigma, limit):
    first = max(0, int(np.ceil(half + x - limit)))
    last = min(signal.shape[1] - 1, int(np.floor(half + x + limit)))
    value, ratio, bend = _bell_steps(first - half - x, sigma)
    energy = total = energy_of_all = total_of_all = 0.0
    for k in range(first, last + 1):
        energy_of_all += value * value
        total_of_all += value * signal[n, k]
        if usable[n, k]:
            energy += value * value
            total += value * signal[n, k]
        value *= ratio
        ratio *= bend
    if energy == 0.0:
        energy, total = energy_of_all, total_of_all
    return total / energy if energy > 0.0 else 0.0


@compiled
def _bell_steps(start, sigma):
    """exp(-d^2 / 2 sigma^2) at d = start, what takes it one step on, and what takes that one step on."""
    scale = 0.5 / (sigma * sigma)
    return np.exp(-start * start * scale), np.exp(-(2.0 * start + 1.0) * scale), np.exp(-2.0 * scale)


@compiled
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


@compiled
def _width(signal, n, half, x, filter_sigma, bell, radius):
    start = half + int(np.rint(x)) - radius
    mass = moment = square = 0.0
    for k in range(2 * radius + 1):
        under = signal[n, start + k] * bell[k]
        mass += under
        moment += under * k
        square += under * k * k
    if mass <= 0.0:
        return 0.0
    mean = moment / mass
    widest = filter_sigma * filter_sigma
    share = min(max((square / mass - mean * mean) / widest, 0.01), 0.95)
    return np.sqrt(widest * share / (1.0 - share))


@compiled
def _score(signal, usable, n, half, start, amplitude, variance, floor, sigma, limit, farthest, noise, rounds):
    contrast, gain, read_variance = noise
    contrast2, per_gain, still = contrast * contrast, 1.0 / gain, read_variance + floor / gain
    x, a = start, amplitude
    first = max(0, int(np.ceil(half + start - limit)))
    last = min(signal.shape[1] - 1, int(np.floor(half + start + limit)))
    per_s2 = 1.0 / (sigma * sigma)
    information = 0.0
    for _ in range(rounds):
        g, ratio, bend = _bell_steps(first - half - x, sigma)
        xx = xa = aa = bx = ba = 0.0
        for k in range(first, last + 1):
            if usable[n, k]:
                m = a * g
                weight = 1.0 / (contrast2 * m * m + m * per_gain + still)
                by_x = m * (k - half - x) * per_s2
                residual = signal[n, k] - m
                xx += weight * by_x * by_x
                xa += weight * by_x * g
                aa += weight * g * g
                bx += weight * by_x * residual
                ba += weight * g * residual
            g *= ratio
            ratio *= bend
        determinant = xx * aa - xa * xa
        if determinant <= 1e-9 * xx * aa:
            information = 0.0
            break
        information = determinant / aa
        dx = (aa * bx - xa * ba) / determinant
        da = (xx * ba - xa * bx) / determinant
        x += min(max(dx, -0.5 * sigma), 0.5 * sigma)
        a = min(max(a + da, 0.5 * a), 2.0 * a)
    if information > 0.0 and abs(x - start) <= farthest:
        return x, a, 1.0 / information
    return start, amplitude, variance


@compiled
def leftovers(signal, usable, offset, amplitude, is_found, sigma, reach, noise, least_free, terms, squares):
    """terms: (CLASSES, 3), squares: (CLASSES,), zeros to begin with. Returns pixels and the step of sigma."""
    contrast, gain, read_variance = noise
    classes = len(squares)
    half = signal.shape[1] // 2
    top = 0.0
    for n in range(len(signal)):
        top = max(top, amplitude[n])
    pixels = 0
    along = across = 0.0
    for n in range(len(signal)):
        if not is_found[n]:
            continue
        x, a = offset[n], amplitude[n]
        first = max(0, int(np.ceil(half + x - reach)))
        last = min(signal.shape[1] - 1, int(np.floor(half + x + reach)))
        start, ratio_start, bend = _bell_steps(first - half - x, sigma)
        heights = places = sigmas = 0.0
        g, ratio = start, ratio_start
        for k in range(first, last + 1):
            if usable[n, k]:
                m = a * g
                d = k - half - x
                weight = 1.0 / (contrast * contrast * m * m + m / gain + read_variance)
                heights += weight * g * g
                places += weight * g * g * d * d
                sigmas += weight * m * d * d * g
            g *= ratio
            ratio *= bend
        heights, places = max(heights, 1e-12), max(places, 1e-12)
        share = sigmas / heights
        g, ratio = start, ratio_start
        for k in range(first, last + 1):
            if usable[n, k]:
                m = a * g
                d = k - half - x
                weight = 1.0 / (contrast * contrast * m * m + m / gain + read_variance)
                residual = signal[n, k] - m
                taken = weight * g * g / heights + weight * g * g * d * d / places
                number = min(int(classes * np.sqrt(m / top)), classes - 1)
                terms[number, 0] += m * m
                terms[number, 1] += m
                terms[number, 2] += 1.0
                squares[number] += residual * residual / max(1.0 - taken, least_free)
                own = m * d * d - share * g
                along += weight * residual * own
                across += weight * own * own
                pixels += 1
            g *= ratio
            ratio *= bend
    for number in range(classes):
        many = terms[number, 2]
        if many > 0.0:
            terms[number, 0] /= many
            terms[number, 1] /= many
            terms[number, 2] = 1.0
            squares[number] /= many
    return pixels, along / max(across, 1e-12) * sigma * sigma
