"""How long a turn is, found in the pictures of an object that turns several times.

Two frames one turn apart look alike. The median difference of all pairs of frames at one distance in time is
small at whole turns and only there: the idea of the average magnitude difference function (Ross et al. 1974),
known from finding the pitch of speech, with a median because the table may stand still for a while at the
beginning or the end.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats

# Beyond this many pictures the search begins on every second, third, ...
_MOST_COARSE = 1500
# Pairs at one distance that there must be, as a share of all pictures.
_LEAST_OVERLAP = 0.15
_LEAST_CONTRAST = 0.6
# Pictures by which a steady table may be off after a turn.
_STEADY_WITHIN = 2
_FEWEST = 12


@dataclass(frozen=True, eq=False, slots=True)
class TurnLength:
    """What a clip says about its own turns.

    Attributes:
        frames: pictures in one turn, to a fraction; NaN where the clip is not periodic.
        sigma_frames: uncertainty of it, from the disagreement of one, two, three... turns.
        contrast: 1 where pictures a turn apart are the same, 0 where they differ as any two do.
        first: the first picture at which the table turns steadily.
        last: the last such picture.
        curve: (L,) median squared difference by distance in pictures, 1 for unrelated pictures.
    """

    frames: float
    sigma_frames: float
    contrast: float
    first: int
    last: int
    curve: Floats

    @property
    def is_periodic(self) -> bool:
        return bool(np.isfinite(self.frames))

    @property
    def turns(self) -> float:
        """Turns between the first and the last steady picture."""
        return (self.last - self.first) / self.frames


def find_turn(thumbnails: NDArray[np.uint8]) -> TurnLength:
    """The length of a turn.

    A clip must show a turn and a bit more. An object that looks the same after half a turn cannot be told
    from one that turns twice as fast.

    Args:
        thumbnails: (N, h, w) small grey pictures at equal distances in time.
    """
    count = len(thumbnails)
    if count < _FEWEST:
        return _not_periodic(count, np.ones(max(count, 1)))
    pictures = thumbnails.reshape(count, -1).astype(np.float32)
    pictures -= np.median(pictures[:: max(1, count // 200)], axis=0)
    stride = -(-count // _MOST_COARSE)
    curve = _lag_curve(pictures[::stride])
    lag = _shortest_turn(curve)
    if lag == 0:
        return _not_periodic(count, curve, _contrast(curve))
    frames, _ = _refine(pictures, float(lag * stride), stride)
    first, last = _steady_part(pictures, frames)
    # Pairs with a picture from before the table turned pull the dips towards them.
    frames, sigma = _refine(pictures[first : last + 1], frames, 1)
    return TurnLength(frames, sigma, 1.0 - float(curve[lag]), first, last, curve)


def _not_periodic(count: int, curve: Floats, contrast: float = 0.0) -> TurnLength:
    nan = float("nan")
    return TurnLength(nan, nan, contrast, 0, count - 1, curve)


def _contrast(curve: Floats) -> float:
    risen = np.flatnonzero(curve > 0.5)
    return float(max(0.0, 1.0 - curve[risen[0] :].min())) if len(risen) else 0.0


def _lag_curve(pictures: NDArray[np.float32]) -> Floats:
    """Median squared difference of pictures (N, p) by lag, 1 where they are unrelated."""
    power = np.einsum("ij,ij->i", pictures, pictures)
    product = pictures @ pictures.T
    most = int(len(pictures) * (1.0 - _LEAST_OVERLAP))
    curve = np.array(
        [
            np.median(power[lag:] + power[: len(power) - lag] - 2.0 * np.diagonal(product, lag))
            for lag in range(most)
        ]
    )
    level = float(np.median(curve))
    scaled: Floats = np.maximum(curve, 0.0) / level if level > 0.0 else np.ones(most)
    return scaled


def _shortest_turn(curve: Floats) -> int:
    """The lag of the first dip that is as deep as the deepest; 0 where no dip is deep enough.

    The dips of two, three... turns are as deep as that of one, those of a symmetric object's half turn are
    shallower. A turn that ends between two frames has a shallower dip too, by a share of what one frame's
    distance makes.
    """
    risen = np.flatnonzero(curve > 0.5)
    if not len(risen):
        return 0
    start = int(risen[0])
    inner = curve[start + 1 : -1]
    is_dip = (inner <= curve[start:-2]) & (inner < curve[start + 2 :]) & (inner < 1.0 - _LEAST_CONTRAST)
    dips = np.flatnonzero(is_dip) + start + 1
    if not len(dips):
        return 0
    deepest = float(curve[dips].min())
    tolerance = 0.5 * float(curve[1]) + 0.5 * deepest + 0.01
    return int(dips[curve[dips] <= deepest + tolerance][0])


def _refine(pictures: NDArray[np.float32], frames: float, reach: int) -> tuple[float, float]:
    """Turn length and its sigma by a line through the dips of one, two, three... turns."""
    found: list[tuple[int, float]] = []
    while True:
        number = len(found) + 1
        guess = frames * number
        if guess + reach + 2 > len(pictures) * (1.0 - _LEAST_OVERLAP):
            break
        found.append((number, _dip_near(pictures, guess, reach + 1)))
        reach = 1
        numbers, lags = np.array(found).T
        frames = float(numbers @ lags / (numbers @ numbers))
    if not found:
        return frames, float("nan")
    numbers, lags = np.array(found).T
    spread = float(np.sqrt(np.mean((lags / numbers - frames) ** 2)))
    # A single dip is located to about a tenth of a frame.
    return frames, max(spread, 0.1 / float(np.sqrt(numbers @ numbers)))


def _dip_near(pictures: NDArray[np.float32], guess: float, reach: int) -> float:
    """The lowest place of the lag curve near a lag, by a parabola through it and its neighbours."""
    lags = np.arange(max(1, round(guess) - reach - 1), min(len(pictures) - 1, round(guess) + reach + 2))
    heights = np.array([np.median(_differences(pictures, int(lag))) for lag in lags])
    lowest = int(np.clip(np.argmin(heights), 1, len(lags) - 2))
    before, here, after = heights[lowest - 1 : lowest + 2]
    bend = before - 2.0 * here + after
    return float(lags[lowest]) + (
        float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
    )


def _differences(pictures: NDArray[np.float32], lag: int) -> NDArray[np.float32]:
    """Squared differences of all pairs at that lag: (N - lag,)."""
    apart = pictures[lag:] - pictures[: len(pictures) - lag]
    squared: NDArray[np.float32] = np.einsum("ij,ij->i", apart, apart)
    return squared


def _steady_part(pictures: NDArray[np.float32], frames: float) -> tuple[int, int]:
    """First and last picture that look like the one a turn later or earlier."""
    lag = round(frames)
    apart = _differences(pictures, lag)
    off_a_little = np.median(_differences(pictures, lag + _STEADY_WITHIN))
    alike = apart <= max(float(off_a_little), 3.0 * float(np.median(apart)))
    is_steady = np.zeros(len(pictures), np.bool_)
    is_steady[: len(alike)] |= alike
    is_steady[lag:] |= alike
    steady = np.flatnonzero(is_steady)
    return (int(steady[0]), int(steady[-1])) if len(steady) else (0, len(pictures) - 1)
