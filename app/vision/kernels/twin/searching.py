"""The strongest peaks of every line, in NumPy and OpenCV."""

import cv2
import numpy as np

from app.geometry.arrays import Floats
from app.vision.kernels.results import BLOCK, HIGH, LOW, REACH, SUMMIT_REACH, TEXTURE_STEP, Peaks
from app.vision.stripe import Image


def difference(lit: Image, dark: Image, channel: int) -> Image:
    """How much brighter (H, W) each pixel of one channel is with the laser on; never below 0."""
    if lit.ndim == 2:
        return np.asarray(cv2.subtract(lit, dark), np.uint8)
    return np.asarray(
        cv2.subtract(cv2.extractChannel(lit, channel), cv2.extractChannel(dark, channel)), np.uint8
    )


def find_peaks_between(lit: Image, dark: Image, channel: int, least: int, count: int) -> Peaks:
    """The `count` strongest peaks of every line of lit minus dark, and the height of the next."""
    response = difference(lit, dark, channel)
    return find_peaks(response, response, least, count)


def find_peaks(response: Image, light: Image, least: int, count: int) -> Peaks:
    """The `count` strongest peaks of every line, and the height of the next.

    Args:
        response: (H, W) how much each pixel looks like laser; it decides where the peaks are.
        light: (H, W) brightness above the surroundings; it decides what shape they have.
        least: a lower summit of the response is none, 1..255.
        count: peaks per line.
    """
    lines, width = response.shape
    height, centre = np.zeros((lines, count + 1)), np.zeros((lines, count))
    sigma = np.full((lines, count), np.nan)
    left = response.copy()
    for rank in range(count + 1):
        column = np.argmax(left, axis=1)
        summit = left[np.arange(lines), column]
        which = np.flatnonzero(summit >= max(least, 1))
        if len(which) == 0:
            break
        height[which, rank] = summit[which]
        if rank == count:
            break
        column = column[which]
        near = np.clip(column[:, None] + np.arange(-SUMMIT_REACH, SUMMIT_REACH + 1), 0, width - 1)
        column = near[np.arange(len(which)), np.argmax(light[which[:, None], near], axis=1)]
        peak = light[which, column].astype(np.float64)
        across = column[:, None] + np.arange(-REACH, REACH + 1)
        inside = (across >= 0) & (across < width)
        around = np.where(inside, light[which[:, None], np.clip(across, 0, width - 1)], 0).astype(np.float64)
        to_left, to_right = around[:, REACH::-1], around[:, REACH:]
        high = _fall(to_left, HIGH * peak) + _fall(to_right, HIGH * peak)
        low = _fall(to_left, LOW * peak) + _fall(to_right, LOW * peak)
        centre[which, rank] = column + 0.5 * (_fall(to_right, 0.5 * peak) - _fall(to_left, 0.5 * peak))
        # A bell's squared widths at two heights differ by 8 sigma^2 log(high / low), clipped or not.
        sigma[which, rank] = np.sqrt(np.maximum(low * low - high * high, 0.0) / (8.0 * np.log(HIGH / LOW)))
        # A peak ends where it has fallen to a quarter, and as much again further out.
        ends = _fall(to_left, 0.25 * peak), _fall(to_right, 0.25 * peak)
        spread = np.ceil(ends[0] + ends[1])
        columns = np.arange(width)
        taken = (columns >= (column - ends[0] - spread)[:, None]) & (
            columns <= (column + ends[1] + spread)[:, None]
        )
        left[which] = np.where(taken, 0, left[which])
    return Peaks(height, centre, sigma, _texture(response))


def _texture(response: Image) -> float:
    sample = response[::TEXTURE_STEP]
    padded = np.pad(sample, ((0, 0), (0, -sample.shape[1] % BLOCK)))
    summits = np.sort(padded.reshape(-1, BLOCK).max(axis=1))
    return float(summits[(len(summits) + 3) // 4 - 1])


def _fall(flank: Floats, level: Floats) -> Floats:
    """How far from the summit (N, R + 1) the flank crosses a level for the first time; R where never."""
    below = flank[:, 1:] < level[:, None]
    at = np.argmax(below, axis=1)
    rows = np.arange(len(flank))
    upper, lower = flank[rows, at], flank[rows, at + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = at + (upper - level) / (upper - lower)
    return np.where(below.any(axis=1), distance, float(flank.shape[1] - 1))
