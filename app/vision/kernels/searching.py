"""Loops that find the strongest peaks of every line.

Pictures are handed on whole, with the number of the line: cutting a line out of an array costs more than
reading one. Constants come as arguments: machine code on disk does not notice when another file changes.
"""

import numpy as np

from app.vision.kernels.jit import compiled


@compiled
def maxima(lit, dark, stride, channel, block_size):
    """Largest difference of every whole block of each line, (H, blocks); it is never written down.

    The other channels are masked rather than skipped, since whole vectors are faster to read than every third
    byte. What is left of a line is the business of `last_maxima`: with a second loop in here, or in one
    function with what follows, the compiler does without vectors.

    lit, dark: (H, W * stride) uint8, channels interleaved.
    """
    lines, length = lit.shape
    size = block_size * stride
    whole = length // size
    blocks = (length + size - 1) // size
    mask = np.zeros(size, np.uint8)
    mask[channel::stride] = 255
    most = np.zeros((lines, blocks), np.uint8)
    for line in range(lines):
        a, b = lit[line], dark[line]
        for block in range(whole):
            first = block * size
            largest = np.uint8(0)
            for i in range(size):
                x, y = a[first + i], b[first + i]
                largest = max(largest, np.uint8((max(x, y) - y) & mask[i]))
            most[line, block] = largest
    return most


@compiled
def last_maxima(lit, dark, stride, channel, block_size, most):
    """The block that the end of the line cuts."""
    width = lit.shape[1] // stride
    block = width // block_size
    for line in range(len(lit)):
        largest = np.int64(0)
        for column in range(block * block_size, width):
            largest = max(largest, _light(lit, dark, True, line, column * stride + channel))
        most[line, block] = largest


@compiled
def summits(most, step):
    """How many blocks of every so many lines reach each grey level: (256,)."""
    counts = np.zeros(256, np.int64)
    for line in range(0, len(most), step):
        for block in range(most.shape[1]):
            counts[most[line, block]] += 1
    return counts


@compiled
def peaks(on, off, a, b, is_pair, stride, channel, most, limits, height, centre, sigma):
    """on - off is the response, a - b the light, (H, W * stride); `most` is used up.

    limits: least height, size of a block, reach of a summit, reach of a flank, the high and low share of a
    peak at which its width is taken, and what squared widths are divided by.
    """
    taken = np.zeros((centre.shape[1], 2), np.int64)
    width = on.shape[1] // stride
    for line in range(len(on)):
        _peaks_of_line(on, off, a, b, is_pair, line, most, taken, stride, channel, width,
                       limits, height, centre, sigma)  # fmt: skip


@compiled
def _light(a, b, is_pair, line, index):
    row, place = np.uint64(line), np.uint64(index)
    x = np.int64(a[row, place])
    if is_pair:
        return max(x - np.int64(b[row, place]), 0)
    return x


@compiled
def _peaks_of_line(
    on, off, a, b, is_pair, line, most, taken, stride, channel, width, limits, height, centre, sigma
):
    """Highest peak, take it out, next.

    on - off is the response, a - b the light; `most[line]` the maximum of each block of the response.
    """
    least, block_size, summit_reach, reach, high_share, low_share, width_scale = limits
    ranks = len(taken)
    row = np.uint64(line)
    blocks = np.uint64(most.shape[1])
    for rank in range(ranks + 1):
        summit = np.uint8(0)
        for block in range(blocks):
            summit = max(summit, most[row, block])
        if summit < least:
            break
        height[line, rank] = summit
        if rank == ranks:
            break
        best = np.uint64(0)
        while most[row, best] != summit:
            best += np.uint64(1)
        column = np.int64(best) * block_size
        while _light(on, off, True, line, column * stride + channel) != summit or _is_taken(
            column, taken, rank
        ):
            column += 1
        peak, start = np.int64(-1), column
        for near in range(column - summit_reach, column + summit_reach + 1):
            spot = min(max(near, 0), width - 1)
            value = _light(a, b, is_pair, line, spot * stride + channel)
            if value > peak:
                peak, start = value, spot
        shares = (high_share, low_share)
        high_l, half_l, low_l, end_l = _falls(
            a, b, is_pair, line, stride, channel, width, start, -1, peak, reach, shares
        )
        high_r, half_r, low_r, end_r = _falls(
            a, b, is_pair, line, stride, channel, width, start, 1, peak, reach, shares
        )
        centre[line, rank] = start + 0.5 * (half_r - half_l)
        low, high = low_l + low_r, high_l + high_r
        sigma[line, rank] = np.sqrt(max(low * low - high * high, 0.0) / width_scale)
        spread = np.ceil(end_l + end_r)
        first = int(max(np.ceil(start - end_l - spread), 0.0))
        last = int(min(np.floor(start + end_r + spread), width - 1.0))
        taken[rank, 0], taken[rank, 1] = first, last
        for block in range(first // block_size, last // block_size + 1):
            begin, end = block * block_size, min((block + 1) * block_size, width)
            if rank == 0:
                before = _largest(on, off, row, begin, min(end, first), stride, channel)
                after = _largest(on, off, row, max(begin, last + 1), end, stride, channel)
                most[line, block] = max(before, after)
            else:
                most[line, block] = _largest_left(on, off, line, begin, end, stride, channel, taken, rank + 1)


@compiled
def _largest(a, b, row, begin, end, stride, channel):
    """Unsigned places: for signed ones every fetch would first ask whether it counts from the end."""
    largest = np.uint8(0)
    index, step = np.uint64(begin * stride + channel), np.uint64(stride)
    for _ in range(end - begin):
        x, y = a[row, index], b[row, index]
        largest = max(largest, np.uint8(max(x, y) - y))
        index += step
    return largest


@compiled
def _largest_left(on, off, line, begin, end, stride, channel, taken, ranks):
    largest = np.int64(0)
    for column in range(begin, end):
        if not _is_taken(column, taken, ranks):
            largest = max(largest, _light(on, off, True, line, column * stride + channel))
    return largest


@compiled
def _is_taken(column, taken, ranks):
    found = False
    for rank in range(ranks):
        found |= taken[rank, 0] <= column <= taken[rank, 1]
    return found


@compiled
def _falls(a, b, is_pair, line, stride, channel, width, start, step, peak, reach, shares):
    """How far from the summit the flank first crosses four shares of its height; reach where never."""
    high = half = low = end = float(reach)
    high_share, low_share = shares
    upper = float(peak)
    passed = 0
    for at in range(reach):
        spot = start + step * (at + 1)
        lower = 0.0
        if 0 <= spot < width:
            lower = float(_light(a, b, is_pair, line, spot * stride + channel))
        if passed == 0 and lower < high_share * peak:
            high = at + (upper - high_share * peak) / (upper - lower)
            passed = 1
        if passed == 1 and lower < 0.5 * peak:
            half = at + (upper - 0.5 * peak) / (upper - lower)
            passed = 2
        if passed == 2 and lower < low_share * peak:
            low = at + (upper - low_share * peak) / (upper - lower)
            passed = 3
        if passed == 3 and lower < 0.25 * peak:
            end = at + (upper - 0.25 * peak) / (upper - lower)
            break
        upper = lower
    return high, half, low, end
