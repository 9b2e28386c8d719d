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
    off = np.zeros(2 * half + 1)
    for n in range(len(line)):
        a, b = lit[line[n]], dark[line[n]]
        left = column[n] - half
        first, last = max(0, -left), min(2 * half, width - 1 - left)
        total, darkest, bright = 0.0, np.inf, 0
        for k in range(first, last + 1):
            index = (left + k) * stride + channel
            off[k] = b[index]
            signal[n, k] = float(a[index]) - off[k]
            is_clipped = a[index] >= clipped_from
            usable[n, k] = not is_clipped
            if is_clipped and abs(k - half) <= core:
                bright += 1
            total += off[k]
            darkest = min(darkest, off[k])
        clipped[n] = bright
        level = total / max(last - first + 1, 1)
        floor[n] = 2.0 * level
        if albedo_noise <= 0.0 or bright > 0 or darkest < 25.0:
            continue
        spread = 0.0
        for k in range(first, last + 1):
            spread += (off[k] - level) ** 2
        spread /= max(last - first + 1, 1)
        if spread > 0.01 * level * level and spread > 16.0 * (albedo_noise + 0.03 * level):
            for k in range(first, last + 1):
                signal[n, k] *= level / max(off[k], 1.0)


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
