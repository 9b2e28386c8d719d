"""The loops over pixels: compiled where numba is installed, NumPy and OpenCV where it is not."""

import importlib
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.kernels import twin
from app.vision.kernels.results import Leftovers, Peaks, Refined, Shape, Windows
from app.vision.stripe import Image


class Kernels(Protocol):
    """Both implementations; described in `twin`."""

    def colour_excess(self, own: Image, first: Image, second: Image) -> Image: ...

    def find_peaks_between(self, lit: Image, dark: Image, channel: int, least: int, count: int) -> Peaks: ...

    def find_peaks(self, response: Image, light: Image, least: int, count: int) -> Peaks: ...

    def cut_windows_between(
        self, lit: Image, dark: Image, channel: int, line: NDArray[np.intp], column: NDArray[np.intp],
        half: int, core: int, albedo_noise: float,
    ) -> Windows: ...  # fmt: skip

    def cut_windows(
        self, lit: Image, light: Image, channel: int, line: NDArray[np.intp], column: NDArray[np.intp],
        half: int, core: int, foot: int,
    ) -> Windows: ...  # fmt: skip

    def refine(self, windows: Windows, shape: Shape, is_scored: bool) -> tuple[Refined, Refined]: ...

    def misfits(self, windows: Windows, fit: Refined, shape: Shape) -> Floats: ...

    def leftovers(self, windows: Windows, fit: Refined, shape: Shape) -> Leftovers: ...

    def noise_terms(self, means: Floats, squares: Floats, least: float) -> tuple[float, float, float]: ...

    def has_company(self, line: NDArray[np.intp], across: Floats) -> NDArray[np.bool_]: ...

    def in_long_pieces(self, line: NDArray[np.intp], across: Floats) -> NDArray[np.bool_]: ...

    def median_bend(self, line: NDArray[np.intp], across: Floats) -> float: ...

    def along_pieces(
        self, line: NDArray[np.intp], across: Floats, variance: Floats, rows: int, measures_noise: bool
    ) -> tuple[Floats, Floats, NDArray[np.intp]]: ...


@cache
def kernels(compiled: bool | None = None) -> Kernels:
    """The compiled kernels or their NumPy twin.

    Args:
        compiled: which; None takes the compiled ones where they can be had.

    Raises:
        ImportError: compiled ones are asked for and numba is missing.
    """
    if compiled is False:
        return twin
    try:
        fast: Kernels = importlib.import_module("app.vision.kernels.compiled")
    except ImportError:
        if compiled:
            raise
        return twin
    return fast
