"""Videos that were padded: each picture repeated to reach a rate the camera never had."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats

# A repeated picture differs from the one before it by the noise of compression only.
_LEAST_SEPARATION = 8.0
_LEAST_REGULAR = 0.7
# What comes sooner than this share of the rhythm is a key frame.
_EARLIEST = 0.8


@dataclass(frozen=True, eq=False, slots=True)
class Padding:
    """Which frames of a video are pictures of their own.

    Attributes:
        kept: (K,) indices of the frames that are.
        ordinals: (K,) their numbers in the camera's own even rhythm, from 0; a lost one leaves a gap.
        stride: frames of the video for each picture of the camera; 1 where nothing was padded.
    """

    kept: NDArray[np.intp]
    ordinals: NDArray[np.intp]
    stride: float


def find_padding(changes: Floats, places: NDArray[np.intp]) -> Padding:
    """Tell repeated frames from new ones by how much each changes.

    The changes must fall into two heaps, far apart and the large ones in an even rhythm. Key frames of the
    video change a repeated picture as much as a new one does; they are known by coming too early.

    Args:
        changes: (N,) mean absolute grey difference of each frame to the one before it.
        places: (N,) number of each frame in the video, rising; a lost frame leaves a gap.
    """
    nothing_padded = Padding(np.arange(len(changes)), places - places[:1], 1.0)
    if len(changes) < 8:
        return nothing_padded
    changes = changes[1:]
    is_new = changes > _otsu(changes)
    if not is_new.any() or is_new.all():
        return nothing_padded
    if changes[is_new].mean() < _LEAST_SEPARATION * changes[~is_new].mean():
        return nothing_padded
    news = np.flatnonzero(is_new) + 1
    gaps = np.diff(places[news])
    if len(gaps) < 4:
        return nothing_padded
    typical = float(np.median(gaps))
    if typical < 1.5 or np.mean(np.abs(gaps - typical) <= 1.0) < _LEAST_REGULAR:
        return nothing_padded
    typical = float(np.mean(gaps[np.abs(gaps - typical) <= 1.0]))
    kept = _in_rhythm(news, places, typical)
    strides = np.diff(places[kept])
    ordinals = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(strides / typical)))]).astype(np.intp)
    stride = float(np.polyfit(ordinals, places[kept], 1)[0])
    return Padding(kept, ordinals, stride)


def _in_rhythm(news: NDArray[np.intp], places: NDArray[np.intp], typical: float) -> NDArray[np.intp]:
    kept = [0]
    for index in news.tolist():
        # An even rhythm on whole frames swings by one frame at most.
        if places[index] - places[kept[-1]] >= min(_EARLIEST * typical, typical - 1.0):
            kept.append(index)
    return np.array(kept, np.intp)


def _otsu(values: Floats) -> float:
    """The value that parts two heaps best: Otsu 1979."""
    ordered = np.sort(values)
    count = np.arange(1, len(ordered))
    below = np.cumsum(ordered)[:-1]
    mean_below, mean_above = below / count, (ordered.sum() - below) / (len(ordered) - count)
    best = int(np.argmax(count * (len(ordered) - count) * (mean_above - mean_below) ** 2))
    return float(ordered[best])
