"""Loops that find the strongest peaks of every line."""

import numpy as np

from app.vision.kernels.jit import compiled
from app.vision.kernels.results import HIGH, LOW, REACH, SUMMIT_REACH

_BLOCK = 64
_WIDTH_SCALE = 8.0 * np.log(HIGH / LOW)


@compiled
def peaks_between(lit, dark, stride, channel, least, height, centre, sigma):  # type: ignore[no-untyped-def]
    """Fused over both pictures: the difference of a line never leaves the nearest cache.

    lit, dark: (H, W * stride) uint8, channels interleaved. The other channels are masked rather than skipped,
    since whole vectors are faster to read than every third byte.
    """
    lines, length = lit.shape
    size = _BLOCK * stride
    blocks = (length + size - 1) // size
    response = np.zeros(blocks * size, np.uint8)
    mask = np.zeros(size, np.uint8)
    mask[channel::stride] = 255
    most = np.zeros(blocks, np.uint8)
    for line in range(lines):
        a, b = lit[line], dark[line]
        for block in range(blocks):
            first = block * size
            count = min(size, length - first)
            most[block] = _difference(
                a[first : first + count], b[first : first + count], mask, response[first : first + count]
            )
        _peaks_of_line(response, most, size, a, b, True, stride, channel, length // stride, least,
                       height[line], centre[line], sigma[line])  # fmt: skip


@compiled
def peaks_of(response, light, least, height, centre, sigma):  # type: ignore[no-untyped-def]
    """response, light: (H, W) uint8."""
    lines, length = response.shape
    blocks = (length + _BLOCK - 1) // _BLOCK
    left = np.zeros(blocks * _BLOCK, np.uint8)
    most = np.zeros(blocks, np.uint8)
    for line in range(lines):
        left[:length] = response[line]
        for block in range(blocks):
            most[block] = _largest(left[block * _BLOCK : (block + 1) * _BLOCK])
        _peaks_of_line(left, most, _BLOCK, light[line], light[line], False, 1, 0, length, least,
                       height[line], centre[line], sigma[line])  # fmt: skip


@compiled
def _difference(a, b, mask, out):  # type: ignore[no-untyped-def]
    largest = np.uint8(0)
    for i in range(len(a)):
        x, y = a[i], b[i]
        value = np.uint8((max(x, y) - y) & mask[i])
        out[i] = value
        largest = max(largest, value)
    return largest


@compiled
def _largest(values):  # type: ignore[no-untyped-def]
    largest = np.uint8(0)
    for i in range(len(values)):
        largest = max(largest, values[i])
    return largest


@compiled
def _light(a, b, is_pair, index):  # type: ignore[no-untyped-def]
    x = a[index]
    if is_pair:
        y = b[index]
        return float(x - y) if x > y else 0.0
    return float(x)


@compiled
def _peaks_of_line(left, most, size, a, b, is_pair, stride, channel, width, least, height, centre, sigma):  # type: ignore[no-untyped-def]
    """Highest peak, take it out, next; `left` (padded) is what has not been taken, `most` its blocks' maxima."""
    ranks = len(centre)
    for rank in range(ranks + 1):
        best = 0
        for block in range(len(most)):
            if most[block] > most[best]:
                best = block
        summit = most[best]
        if summit < least:
            break
        height[rank] = summit
        if rank == ranks:
            break
        at = best * size
        while left[at] != summit:
            at += 1
        column = at // stride
        peak, start = -1.0, column
        for near in range(column - SUMMIT_REACH, column + SUMMIT_REACH + 1):
            spot = min(max(near, 0), width - 1)
            value = _light(a, b, is_pair, spot * stride + channel)
            if value > peak:
                peak, start = value, spot
        high_l, half_l, low_l, end_l = _falls(a, b, is_pair, stride, channel, width, start, -1, peak)
        high_r, half_r, low_r, end_r = _falls(a, b, is_pair, stride, channel, width, start, 1, peak)
        centre[rank] = start + 0.5 * (half_r - half_l)
        low, high = low_l + low_r, high_l + high_r
        sigma[rank] = np.sqrt(max(low * low - high * high, 0.0) / _WIDTH_SCALE)
        spread = np.ceil(end_l + end_r)
        first = int(max(np.ceil(start - end_l - spread), 0.0))
        last = int(min(np.floor(start + end_r + spread), width - 1.0))
        for spot in range(first, last + 1):
            left[spot * stride + channel] = 0
        for block in range(first * stride // size, last * stride // size + 1):
            most[block] = _largest(left[block * size : (block + 1) * size])


@compiled
def _falls(a, b, is_pair, stride, channel, width, start, step, peak):  # type: ignore[no-untyped-def]
    """How far from the summit the flank first crosses four shares of its height; REACH where never."""
    levels = (HIGH * peak, 0.5 * peak, LOW * peak, 0.25 * peak)
    high = half = low = end = float(REACH)
    upper = peak
    passed = 0
    for at in range(REACH):
        spot = start + step * (at + 1)
        lower = 0.0
        if 0 <= spot < width:
            lower = _light(a, b, is_pair, spot * stride + channel)
        if passed == 0 and lower < levels[0]:
            high = at + (upper - levels[0]) / (upper - lower)
            passed = 1
        if passed == 1 and lower < levels[1]:
            half = at + (upper - levels[1]) / (upper - lower)
            passed = 2
        if passed == 2 and lower < levels[2]:
            low = at + (upper - levels[2]) / (upper - lower)
            passed = 3
        if passed == 3 and lower < levels[3]:
            end = at + (upper - levels[3]) / (upper - lower)
            break
        upper = lower
    return high, half, low, end
