"""Loops that find the strongest peaks of every line.

Pictures are handed on whole, with the number of the line: cutting a line out of an array costs more than
reading one. Constants come as arguments: machine code on disk does not notice when another file changes.
"""

import numpy as np

from app.vision.kernels.jit import compiled, inlined

# At a time: so many lines of two colour pictures are no more than a second-level cache holds.
_LINES = 32


@compiled
def search(on, off, a, b, is_pair, stride, channel, limits, step, counts, height, centre, sigma):
    """The peaks of every line, and the texture: how many blocks of every so many lines reach each level.

    A few lines at a time: what the first look has fetched is still at hand for the second.

    on - off is the response, a - b the light, (H, W * stride). limits: least height, size of a block, reach
    of a summit, reach of a flank, the high and low share of a peak at which its width is taken, and what
    squared widths are divided by.
    """
    width = on.shape[1] // stride
    block_size = limits[1]
    blocks = (width + block_size - 1) // block_size
    mask = _mask(block_size * stride, stride, channel)
    # Filled up to whole vectors for the search of the largest one.
    most = np.zeros((len(on), (blocks + 31) // 32 * 32), np.uint8)
    for first in range(0, len(on), _LINES):
        last = min(first + _LINES, len(on))
        maxima(on, off, first, last, mask, most)
        if width % block_size > 0:
            last_maxima(on, off, first, last, stride, channel, block_size, most)
        for line in range(first, last, step):
            for block in range(blocks):
                counts[most[line, block]] += 1
        peaks(on, off, a, b, is_pair, first, last, stride, channel, most, mask, limits, height, centre, sigma)


@compiled
def maxima(lit, dark, first, last, mask, most):
    """Largest difference of every whole block of some lines; it is never written down.

    The other channels are masked rather than skipped, since whole vectors are faster to read than every third
    byte. What is left of a line is the business of `last_maxima`: with a second loop in here, or in one
    function with what follows, the compiler does without vectors.
    """
    size = len(mask)
    for line in range(first, last):
        a, b = lit[line], dark[line]
        for block in range(lit.shape[1] // size):
            start = block * size
            largest = np.uint8(0)
            for i in range(size):
                x, y = a[start + i], b[start + i]
                largest = max(largest, np.uint8((max(x, y) - y) & mask[i]))
            most[line, block] = largest


@inlined
def _mask(size, stride, channel):
    mask = np.zeros(size, np.uint8)
    mask[channel::stride] = 255
    return mask


@compiled
def last_maxima(lit, dark, first, last, stride, channel, block_size, most):
    """The block that the end of the line cuts."""
    width = lit.shape[1] // stride
    block = width // block_size
    for line in range(first, last):
        largest = np.int64(0)
        for column in range(block * block_size, width):
            largest = max(largest, _light(lit, dark, True, line, column * stride + channel))
        most[line, block] = largest


@compiled
def peaks(on, off, a, b, is_pair, first, last, stride, channel, most, mask, limits, height, centre, sigma):
    """`most` is used up."""
    taken = np.zeros((centre.shape[1], 2), np.int64)
    width = on.shape[1] // stride
    keep = mask.copy()
    for line in range(first, last):
        _peaks_of_line(on, off, a, b, is_pair, line, most, taken, stride, channel, width,
                       limits, mask, keep, height, centre, sigma)  # fmt: skip


@inlined
def _light(a, b, is_pair, line, index):
    row, place = np.uint64(line), np.uint64(index)
    x = np.int64(a[row, place])
    if is_pair:
        return max(x - np.int64(b[row, place]), 0)
    return x


@inlined
def _peaks_of_line(
    on, off, a, b, is_pair, line, most, taken, stride, channel, width, limits, mask, keep,
    height, centre, sigma,
):  # fmt: skip
    """Highest peak, take it out, next.

    on - off is the response, a - b the light; `most[line]` the maximum of each block of the response.
    """
    least, block_size, summit_reach, reach, high_share, low_share, width_scale = limits
    ranks = len(taken)
    row = np.uint64(line)
    for rank in range(ranks + 1):
        summit = np.uint8(0)
        for part in range(np.uint64(most.shape[1] // 32)):
            for block in range(np.uint64(32)):
                summit = max(summit, most[row, part * np.uint64(32) + block])
        if summit < least:
            break
        height[line, rank] = summit
        if rank == ranks:
            break
        best = np.uint64(0)
        while most[row, best] != summit:
            best += np.uint64(1)
        column = np.int64(best) * block_size
        place, step = np.uint64(column * stride + channel), np.uint64(stride)
        while max(on[row, place], off[row, place]) - off[row, place] != summit or (
            rank > 0 and _is_taken(column, taken, rank)
        ):
            column += 1
            place += step
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
            if rank == 0 and end - begin == block_size:
                inner = np.uint64(stride * max(first - begin, 0))
                outer = np.uint64(stride * (min(last + 1, end) - begin))
                for i in range(inner, outer):
                    keep[i] = 0
                most[line, block] = _largest_kept(on, off, row, begin * stride, keep)
                for i in range(inner, outer):
                    keep[i] = mask[i]
            elif rank == 0:
                before = _largest(on, off, row, begin, min(end, first), stride, channel)
                after = _largest(on, off, row, max(begin, last + 1), end, stride, channel)
                most[line, block] = max(before, after)
            else:
                most[line, block] = _largest_left(on, off, line, begin, end, stride, channel, taken, rank + 1)


@inlined
def _largest(a, b, row, begin, end, stride, channel):
    """Unsigned places: for signed ones every fetch would first ask whether it counts from the end."""
    largest = np.uint8(0)
    index, step = np.uint64(begin * stride + channel), np.uint64(stride)
    for _ in range(end - begin):
        x, y = a[row, index], b[row, index]
        largest = max(largest, np.uint8(max(x, y) - y))
        index += step
    return largest


@inlined
def _largest_kept(a, b, row, begin, keep):
    """Of a whole block, whose bytes are a multiple of 64: so many at a time are whole vectors."""
    largest = np.uint8(0)
    index, place = np.uint64(begin), np.uint64(0)
    for _ in range(len(keep) // 64):
        for i in range(np.uint64(64)):
            x, y = a[row, index + i], b[row, index + i]
            largest = max(largest, np.uint8((max(x, y) - y) & keep[place + i]))
        index += np.uint64(64)
        place += np.uint64(64)
    return largest


@inlined
def _largest_left(on, off, line, begin, end, stride, channel, taken, ranks):
    largest = np.int64(0)
    for column in range(begin, end):
        if not _is_taken(column, taken, ranks):
            largest = max(largest, _light(on, off, True, line, column * stride + channel))
    return largest


@inlined
def _is_taken(column, taken, ranks):
    found = False
    for rank in range(ranks):
        found |= taken[rank, 0] <= column <= taken[rank, 1]
    return found


@inlined
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
