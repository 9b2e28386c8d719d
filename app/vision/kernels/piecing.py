"""Loops along the stripe: what belongs together, how rough it is, and smoothing inside a piece."""

import numpy as np

from app.vision.kernels.jit import compiled_briefly as compiled

_MAD_TO_SIGMA = 1.4826


@compiled
def company(line, across):
    """Whether each point has at least two others within three lines that could be the same stripe."""
    n = len(line)
    near = np.zeros(n, np.int64)
    for i in range(n):
        for j in range(i + 1, min(i + 4, n)):
            lines = line[j] - line[i]
            if lines <= 3 and abs(across[j] - across[i]) <= 1.0 + 3.0 * lines:
                near[i] += 1
                near[j] += 1
    return near >= 2


@compiled
def pieces(line, across, largest_step):
    """Number of the unbroken piece every point belongs to."""
    n = len(line)
    segment = np.zeros(n, np.int64)
    around = np.empty(7)
    for i in range(n - 1):
        step = across[i + 1] - across[i]
        is_broken = line[i + 1] - line[i] != 1
        if not is_broken and abs(step) > largest_step:
            for k in range(-3, 4):
                j = min(max(i + k, 0), n - 2)
                around[k + 3] = across[j + 1] - across[j]
            around.sort()
            is_broken = abs(step - around[3]) > largest_step
        segment[i + 1] = segment[i] + is_broken
    return segment


@compiled
def long_pieces(segment, least):
    """Whether each point's piece has so many lines."""
    n = len(segment)
    is_long = np.empty(n, np.bool_)
    start = 0
    while start < n:
        end = start + 1
        while end < n and segment[end] == segment[start]:
            end += 1
        is_long[start:end] = end - start >= least
        start = end
    return is_long


@compiled
def median_bend(across, segment):
    """Median of how far inner points lie off the middle of their neighbours, doubled, px."""
    bends = np.empty(len(across))
    many = 0
    for i in range(len(across) - 2):
        if segment[i + 2] == segment[i]:
            bends[many] = abs(across[i + 2] - 2.0 * across[i + 1] + across[i])
            many += 1
    return np.median(bends[:many]) if many > 0 else 0.0


@compiled
def noise_scale(across, variance, segment, least):
    bends = np.empty(len(across))
    many = 0
    for i in range(len(across) - 2):
        if segment[i + 2] == segment[i]:
            expected = variance[i] + 4.0 * variance[i + 1] + variance[i + 2]
            bends[many] = abs(across[i + 2] - 2.0 * across[i + 1] + across[i]) / np.sqrt(expected)
            many += 1
    if many < least:
        return 1.0
    sigmas = _MAD_TO_SIGMA * np.median(bends[:many])
    return min(max(sigmas * sigmas, 0.5), 25.0)


@compiled
def smooth(line, across, variance, segment, rows, smoothed, spread):
    """smoothed, spread: (N,) what becomes of positions and variances."""
    n = len(line)
    half = rows // 2
    begin = 0
    for i in range(n):
        if i > 0 and segment[i] != segment[i - 1]:
            begin = i
        smoothed[i], spread[i] = across[i], variance[i]
        first, last = max(i - half, begin), i
        while last < min(i + half, n - 1) and segment[last + 1] == segment[i]:
            last += 1
        if last - first < 2:
            continue
        s0 = s1 = s2 = t0 = t1 = 0.0
        for j in range(first, last + 1):
            weight, x, u = 1.0 / variance[j], float(line[j] - line[i]), across[j] - across[i]
            s0 += weight
            s1 += weight * x
            s2 += weight * x * x
            t0 += weight * u
            t1 += weight * u * x
        determinant = s0 * s2 - s1 * s1
        if determinant > 1e-9 * s0 * s2:
            smoothed[i] = across[i] + (s2 * t0 - s1 * t1) / determinant
            spread[i] = s2 / determinant
