"""The stripe kernels compiled with numba; `twin` says what they do, and gives the same answers."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.kernels import colouring, cutting, fitting, piecing, searching, terms
from app.vision.kernels.jit import compiled_briefly
from app.vision.kernels.results import (
    BLOCK,
    CLASSES,
    CLIPPED_FROM,
    FARTHEST,
    HIGH,
    LEAST_FREE,
    LOW,
    REACH,
    SCORING_REACH,
    SCORING_ROUNDS,
    SUMMIT_REACH,
    TEXTURE_STEP,
    Leftovers,
    Peaks,
    Refined,
    Shape,
    Windows,
)
from app.vision.segments import LARGEST_STEP_PX, LEAST_BENDS, LONG_PIECE
from app.vision.stripe import Image

_noise_terms = compiled_briefly(terms.noise_terms)


def colour_excess(own: Image, first: Image, second: Image) -> Image:
    """As in `twin`."""
    excess = np.empty_like(own)
    colouring.colour_excess(own, first, second, excess)
    return excess


def find_peaks_between(lit: Image, dark: Image, channel: int, least: int, count: int) -> Peaks:
    """As in `twin`; both pictures are read once."""
    on, off = _flat(lit), _flat(dark)
    return _peaks(on, off, (on, off, True), _stride(lit), channel, least, count)


def find_peaks(response: Image, light: Image, least: int, count: int) -> Peaks:
    """As in `twin`."""
    on, light = _flat(response), _flat(light)
    return _peaks(on, np.zeros_like(on), (light, light, False), 1, 0, least, count)


def _peaks(
    on: Image, off: Image, light: tuple[Image, Image, bool], stride: int, channel: int, least: int, count: int
) -> Peaks:
    counts = np.zeros(256, np.int64)
    height, centre = np.zeros((len(on), count + 1)), np.zeros((len(on), count))
    sigma = np.full((len(on), count), np.nan)
    limits = max(least, 1), BLOCK, SUMMIT_REACH, REACH, HIGH, LOW, 8.0 * float(np.log(HIGH / LOW))
    searching.search(on, off, *light, stride, channel, limits, TEXTURE_STEP, counts, height, centre, sigma)
    many = np.cumsum(counts)
    texture = float(np.searchsorted(many, (many[-1] + 3) // 4))
    return Peaks(height, centre, sigma, texture)


def cut_windows_between(
    lit: Image,
    dark: Image,
    channel: int,
    line: NDArray[np.intp],
    column: NDArray[np.intp],
    half: int,
    core: int,
    albedo_noise: float,
) -> Windows:
    """As in `twin`."""
    windows = _no_windows(len(line), half)
    searched = (windows.signal, windows.usable, windows.clipped, windows.floor)
    cutting.windows_between(
        _flat(lit),
        _flat(dark),
        _stride(lit),
        channel,
        line,
        column,
        half,
        core,
        CLIPPED_FROM,
        albedo_noise,
        *searched,
    )
    return windows


def cut_windows(
    lit: Image,
    light: Image,
    channel: int,
    line: NDArray[np.intp],
    column: NDArray[np.intp],
    half: int,
    core: int,
    foot: int,
) -> Windows:
    """As in `twin`."""
    windows = _no_windows(len(line), half)
    cutting.windows_of(
        _flat(lit),
        _flat(light),
        _stride(lit),
        channel,
        line,
        column,
        half,
        core,
        foot,
        CLIPPED_FROM,
        *windows,
    )
    return windows


def refine(windows: Windows, shape: Shape, is_scored: bool) -> tuple[Refined, Refined]:
    """As in `twin`."""
    n = len(windows.signal)
    plain, scored, is_found = np.zeros((4, n)), np.zeros((4, n)), np.zeros(n, np.bool_)
    widths = shape.sigma, shape.filter_sigma
    reaches = shape.filter_radius, shape.search_radius, SCORING_REACH, FARTHEST
    noise = shape.contrast, shape.gain, shape.read_variance
    rounds = SCORING_ROUNDS if is_scored else 0
    fitting.refine(
        windows.signal, windows.usable, windows.floor, widths, reaches, noise, rounds, plain, scored, is_found
    )
    first = Refined(plain[0], plain[1], plain[2], plain[3], is_found)
    return first, Refined(scored[0], scored[1], scored[2], scored[3], is_found) if is_scored else first


def misfits(windows: Windows, fit: Refined, shape: Shape) -> Floats:
    """As in `twin`."""
    found: Floats = fitting.misfits(
        windows.signal, windows.usable, fit.offset, fit.amplitude, shape.sigma, SCORING_REACH * shape.sigma
    )
    return found


def leftovers(windows: Windows, fit: Refined, shape: Shape) -> Leftovers:
    """As in `twin`."""
    means, squares = np.zeros((CLASSES, 3)), np.zeros(CLASSES)
    noise = shape.contrast, shape.gain, shape.read_variance
    pixels, step = fitting.leftovers(
        windows.signal, windows.usable, fit.offset, fit.amplitude, fit.is_found, shape.sigma,
        SCORING_REACH * shape.sigma, noise, LEAST_FREE, means, squares,
    )  # fmt: skip
    return Leftovers(means, squares, pixels, step)


def noise_terms(means: Floats, squares: Floats, least: float) -> tuple[float, float, float]:
    """As in `twin`."""
    found: tuple[float, float, float] = _noise_terms(means, squares, least)
    return found


def has_company(line: NDArray[np.intp], across: Floats) -> NDArray[np.bool_]:
    """As in `segments`."""
    company: NDArray[np.bool_] = piecing.company(line, across)
    return company


def in_long_pieces(line: NDArray[np.intp], across: Floats) -> NDArray[np.bool_]:
    """As in `segments`."""
    is_long: NDArray[np.bool_] = piecing.long_pieces(
        piecing.pieces(line, across, LARGEST_STEP_PX), LONG_PIECE
    )
    return is_long


def median_bend(line: NDArray[np.intp], across: Floats) -> float:
    """As in `twin`."""
    return float(piecing.median_bend(across, piecing.pieces(line, across, LARGEST_STEP_PX)))


def along_pieces(
    line: NDArray[np.intp], across: Floats, variance: Floats, rows: int, measures_noise: bool
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """As in `twin`."""
    segment = piecing.pieces(line, across, LARGEST_STEP_PX)
    if measures_noise:
        variance = variance * piecing.noise_scale(across, variance, segment, LEAST_BENDS)
    if rows >= 2:
        rough, across, spread = across, np.empty_like(across), np.empty_like(across)
        piecing.smooth(line, rough, variance, segment, rows, across, spread)
        variance = spread
    return across, variance, segment


def _flat(image: Image) -> Image:
    return np.ascontiguousarray(image).reshape(len(image), -1)


def _stride(image: Image) -> int:
    return 1 if image.ndim == 2 else int(image.shape[2])


def _no_windows(count: int, half: int) -> Windows:
    size = (count, 2 * half + 1)
    return Windows(
        np.empty(size), np.empty(size, np.bool_), np.zeros(count, np.intp), np.zeros(count), np.zeros(count)
    )
