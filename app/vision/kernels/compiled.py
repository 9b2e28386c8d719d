"""The stripe kernels compiled with numba; `twin` says what they do, and gives the same answers."""

import numpy as np
from numpy.typing import NDArray

from app.vision.kernels import cutting, fitting, searching
from app.vision.kernels.results import Peaks, Refined, Shape, Windows
from app.vision.stripe import Image


def find_peaks_between(lit: Image, dark: Image, channel: int, least: int, count: int) -> Peaks:
    """As in `twin`, in one pass over both pictures."""
    peaks = _no_peaks(len(lit), count)
    searching.peaks_between(_flat(lit), _flat(dark), _stride(lit), channel, max(least, 1), *peaks)
    return peaks


def find_peaks(response: Image, light: Image, least: int, count: int) -> Peaks:
    """As in `twin`."""
    peaks = _no_peaks(len(response), count)
    searching.peaks_of(
        np.ascontiguousarray(response), np.ascontiguousarray(light), max(least, 1), *peaks
    )
    return peaks


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
        _flat(lit), _flat(dark), _stride(lit), channel, line, column, half, core, albedo_noise, *searched
    )
    return windows


def cut_windows(
    lit: Image,
    channel: int,
    line: NDArray[np.intp],
    column: NDArray[np.intp],
    half: int,
    core: int,
    foot: int,
) -> Windows:
    """As in `twin`."""
    windows = _no_windows(len(line), half)
    cutting.windows_of(_flat(lit), _stride(lit), channel, line, column, half, core, foot, *windows)
    return windows


def refine(windows: Windows, shape: Shape, is_scored: bool) -> tuple[Refined, Refined]:
    """As in `twin`."""
    n = len(windows.signal)
    plain, scored, is_found = np.zeros((4, n)), np.zeros((4, n)), np.zeros(n, np.bool_)
    fitting.refine(
        windows.signal, windows.usable, windows.floor, shape.sigma, shape.filter_sigma, shape.filter_radius,
        shape.search_radius, shape.contrast, shape.gain, shape.read_variance, is_scored, plain, scored, is_found,
    )  # fmt: skip
    first = Refined(plain[0], plain[1], plain[2], plain[3], is_found)
    return first, Refined(scored[0], scored[1], scored[2], scored[3], is_found) if is_scored else first


def _flat(image: Image) -> Image:
    return np.ascontiguousarray(image).reshape(len(image), -1)


def _stride(image: Image) -> int:
    return 1 if image.ndim == 2 else int(image.shape[2])


def _no_peaks(lines: int, count: int) -> Peaks:
    return Peaks(np.zeros((lines, count + 1)), np.zeros((lines, count)), np.full((lines, count), np.nan))


def _no_windows(count: int, half: int) -> Windows:
    size = (count, 2 * half + 1)
    return Windows(
        np.zeros(size), np.zeros(size, np.bool_), np.zeros(count, np.intp), np.zeros(count), np.zeros(count)
    )
