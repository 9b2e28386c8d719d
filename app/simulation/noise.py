"""What the sensor adds to the light, and a stripe made of nothing but numbers."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Floats
from app.vision.stripe import Image

_LEVELS = 65536
_REPEATS = 16


@dataclass(frozen=True, slots=True)
class Noise:
    """How a pixel's grey value comes about: theory, section 2: variance C^2 m^2 + m/K + v0.

    Attributes:
        speckle: contrast C of the laser's speckle: standard deviation over mean, gamma distributed.
        electrons_per_grey: K; shot noise has the variance value / K. Infinite for none.
        read_grey: standard deviation of the read noise, grey levels.
    """

    speckle: float = 0.12
    electrons_per_grey: float = 40.0
    read_grey: float = 0.7

    def __post_init__(self) -> None:
        if not 0.0 <= self.speckle <= 1.0:
            raise OptionError(
                f"A speckle contrast of {self.speckle:g} does not exist.", "Give a contrast from 0 to 1."
            )
        if not self.electrons_per_grey > 0.0 or not 0.0 <= self.read_grey < 100.0:
            raise OptionError(
                "The sensor noise must be positive.", "Give electrons per grey above 0, read noise 0 to 100."
            )

    @classmethod
    def none(cls) -> "Noise":
        return cls(0.0, float("inf"), 0.0)


@lru_cache(maxsize=1)
def normal_levels() -> NDArray[np.float32]:
    """Quantiles of the standard normal distribution, one for each 16-bit number."""
    from scipy import special  # a quarter of a second, and rarely wanted

    levels: NDArray[np.float32] = special.ndtri(_shares()).astype(np.float32)
    return levels


@lru_cache(maxsize=1)
def normal_numbers() -> NDArray[np.float32]:
    """A million numbers of the standard normal distribution in random order, always the same ones."""
    rng = np.random.default_rng(_LEVELS)
    numbers: NDArray[np.float32] = rng.permutation(np.tile(normal_levels(), _REPEATS))
    return numbers


@lru_cache(maxsize=8)
def speckle_levels(contrast: float) -> NDArray[np.float32]:
    """Quantiles of a gamma distribution of mean one and that contrast, one for each 16-bit number."""
    if contrast <= 0.0:
        return np.ones(_LEVELS, np.float32)
    from scipy import special

    shape = 1.0 / contrast**2
    quantiles = special.gammaincinv(shape, _shares()) / shape
    levels: NDArray[np.float32] = (quantiles / quantiles.mean()).astype(np.float32)
    return levels


def stripe_image(
    centres: Floats,
    width: int,
    sigma: float = 2.0,
    amplitude: float | Floats = 150.0,
    noise: Noise | None = None,
    seed: int = 0,
    ambient: float = 20.0,
) -> tuple[Image, Image]:
    """A lit and a dark grey picture of a vertical stripe whose centres are known.

    Args:
        centres: (H,) true column of the stripe in each row, px; NaN for a row without stripe.
        width: columns.
        sigma: of the stripe's profile, px.
        amplitude: grey levels above the ambient light, one for all or (H,).
        noise: of the sensor; none by default.
        seed: same seed, same pictures.
        ambient: grey levels without laser.

    Returns:
        The pictures with the laser on and off, (H, width) each, clipped at 255.
    """
    from scipy import special

    noise = noise or Noise.none()
    rng = np.random.default_rng(seed)
    centres = np.asarray(centres, np.float64)
    # The light is gathered over each pixel's width, as on a sensor.
    edges = (np.arange(width + 1) - 0.5 - np.nan_to_num(centres, nan=-1e9)[:, None]) / sigma
    gathered = np.diff(special.ndtr(edges), axis=1) * sigma * np.sqrt(2.0 * np.pi)
    laser = np.broadcast_to(np.asarray(amplitude, np.float64), centres.shape)[:, None] * gathered
    if noise.speckle > 0.0:
        shape = 1.0 / noise.speckle**2
        laser = laser * rng.gamma(shape, 1.0 / shape, laser.shape)
    return (
        _exposed(ambient + laser, noise, rng),
        _exposed(ambient + np.zeros_like(laser), noise, rng),
    )


def _exposed(mean: Floats, noise: Noise, rng: np.random.Generator) -> Image:
    variance = mean / noise.electrons_per_grey + noise.read_grey**2
    seen = mean + rng.standard_normal(mean.shape) * np.sqrt(variance)
    image: Image = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    return image


def _shares() -> Floats:
    return (np.arange(_LEVELS) + 0.5) / _LEVELS
