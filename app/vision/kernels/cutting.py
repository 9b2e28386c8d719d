"""Loops that cut the surroundings of each peak out of the pictures."""

import numpy as np

from app.vision.kernels.jit import compiled


@compiled
def windows_between(
    lit,
    dark,
    stride,
    channel,
    line,
    column,
    half,
    core,
    clipped_from,
    albedo_noise,
    signal,
    usable,
    clipped,
    floor,
):
    """lit, dark: (H, W * stride) uint8, channels interleaved."""
    width = lit.shape[1] // stride
    on, off = np.empty((2, 2 * half + 1), np.uint8)
    limit = np.uint8(clipped_from)
    for n in range(len(line)):
        place = np.uint64(n)
        row, left = np.uint64(line[n]), column[n] - half
        first, last = max(0, -left), min(2 * half, width - 1 - left)
        for k in range(first):
            signal[n, k], usable[n, k] = 0.0, False
        for k in range(last + 1, 2 * half + 1):
            signal[n, k], usable[n, k] = 0.0, False
        # Unsigned places and whole numbers: nothing to ask about each pixel, nothing to convert twice.
        index, step = np.uint64((left + first) * stride + channel), np.uint64(stride)
        for k in range(np.uint64(first), np.uint64(last + 1)):
            on[k], off[k] = lit[row, index], dark[row, index]
            index += step
        total, brightest = np.int32(0), np.uint8(0)
        for k in range(np.uint64(first), np.uint64(last + 1)):
            a, b = on[k], off[k]
            signal[place, k] = np.int32(a) - np.int32(b)
            usable[place, k] = a < limit
            total += np.int32(b)
            brightest = max(brightest, a)
        many = max(last - first + 1, 1)
        level = total / many
        floor[n] = 2.0 * level
        clipped[n] = 0
        if brightest >= clipped_from:
            for k in range(max(first, half - core), min(last, half + core) + 1):
                clipped[n] += not usable[n, k]
        if albedo_noise <= 0.0 or clipped[n] > 0 or level < 25.0:
            continue
        darkest, spread = np.inf, 0.0
        for k in range(first, last + 1):
            value = float(off[k])
            darkest = min(darkest, value)
            spread += (value - level) ** 2
        spread /= many
        if (
            darkest >= 25.0
            and spread > 0.01 * level * level
            and spread > 16.0 * (albedo_noise + 0.03 * level)
        ):
            for k in range(first, last + 1):
                signal[n, k] *= level / max(float(off[k]), 1.0)


@compiled
def windows_of(
    lit,
    light,
    stride,
    channel,
    line,
    column,
    half,
    core,
    foot,
    clipped_from,
    signal,
    usable,
    clipped,
    floor,
    asymmetry,
):
    """lit: (H, W * stride) uint8, channels interleaved; light: (H, W) uint8."""
    width = lit.shape[1] // stride
    for n in range(len(line)):
        a, risen = lit[line[n]], light[line[n]]
        left = column[n] - half
        first, last = max(0, -left), min(2 * half, width - 1 - left)
        for k in range(first):
            signal[n, k], usable[n, k] = 0.0, False
        for k in range(last + 1, 2 * half + 1):
            signal[n, k], usable[n, k] = 0.0, False
        before = after = low_before = low_after = 0.0
        befores = afters = lows_before = lows_after = bright = 0
        for k in range(first, last + 1):
            value = float(a[(left + k) * stride + channel])
            is_clipped = value >= clipped_from
            signal[n, k] = float(risen[left + k])
            usable[n, k] = not is_clipped
            distance = k - half
            if is_clipped and abs(distance) <= core:
                bright += 1
            if abs(distance + core) <= 1:
                before += value
                befores += 1
            if abs(distance - core) <= 1:
                after += value
                afters += 1
            if -core - foot <= distance < -core:
                low_before += signal[n, k]
                lows_before += 1
            if core < distance <= core + foot:
                low_after += signal[n, k]
                lows_after += 1
        before = before / befores if befores > 0 else -1.0
        after = after / afters if afters > 0 else max(before, 0.0)
        if befores == 0:
            before = after
        low_before = low_before / lows_before if lows_before > 0 else np.inf
        low_after = low_after / lows_after if lows_after > 0 else np.inf
        clipped[n] = bright
        floor[n] = 0.5 * (before + after)
        asymmetry[n] = abs(after - before)
        low = min(low_before, low_after)
        if low == np.inf:
            low = 0.0
        for k in range(first, last + 1):
            signal[n, k] -= low
