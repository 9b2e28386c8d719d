"""Stripes of known centre under known noise, and the bound no estimator can beat on them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats
from app.vision.stripe import Image

_PEDESTAL = 10.0
_QUANTISATION = 1.0 / 12.0
_CLIPPED_FROM = 250.0


@dataclass(frozen=True, slots=True)
class Scene:
    """A stripe on a dark surface.

    Attributes:
        name: for the table.
        sigma_px: of the stripe.
        amplitude: grey levels; above 255 the core is clipped.
        contrast: of the speckle, one grain per pixel.
        gain: electrons per grey level.
        read_noise: of one picture, grey levels.
        lines, width: size of the picture.
    """

    name: str
    sigma_px: float = 2.0
    amplitude: float = 150.0
    contrast: float = 0.0
    gain: float = 10.0
    read_noise: float = 1.4
    lines: int = 720
    width: int = 160

    def truth(self) -> Floats:
        """Centre (lines,) of the stripe: a slow slope with a wave, so that every sub-pixel phase occurs."""
        line = np.arange(self.lines)
        return 0.5 * self.width + 0.037 * (line - 0.5 * self.lines) + 4.0 * np.sin(line / 90.0)

    def pair(self, seed: int, centre: Floats | None = None) -> tuple[Image, Image]:
        """The picture with the laser on, and with it off, (lines, width, 3).

        Args:
            seed: of the noise.
            centre: (lines,) another than `truth`.
        """
        rng = np.random.default_rng(seed)
        across = np.arange(self.width) - (self.truth() if centre is None else centre)[:, None]
        mean = self.amplitude * np.exp(-(across**2) / (2.0 * self.sigma_px**2))
        if self.contrast > 0.0:
            grains = 1.0 / self.contrast**2
            mean = mean * rng.gamma(grains, 1.0 / grains, mean.shape)
        light = rng.poisson(mean * self.gain) / self.gain
        pictures = []
        for signal in (light, np.zeros_like(light)):
            grey = _PEDESTAL + signal + rng.normal(0.0, self.read_noise, light.shape)
            plane = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
            pictures.append(np.repeat(plane[:, :, None], 3, axis=2))
        return pictures[0], pictures[1]

    def bound_px(self) -> float:
        """Cramer-Rao bound of the centre, root of the mean over the sub-pixel phases.

        Both centre and amplitude are unknown; the noise of lit minus dark has the variance
        C^2 m^2 + m / K + v0, and a clipped pixel tells nothing.
        """
        phases = np.linspace(-0.5, 0.5, 40, endpoint=False)
        across = np.arange(-40, 41) - phases[:, None]
        bell = np.exp(-(across**2) / (2.0 * self.sigma_px**2))
        mean = self.amplitude * bell
        noise = self.contrast**2 * mean**2 + mean / self.gain + 2.0 * (self.read_noise**2 + _QUANTISATION)
        weight = np.where(mean + _PEDESTAL < _CLIPPED_FROM, 1.0 / noise, 0.0)
        by_centre = mean * across / self.sigma_px**2
        centre = (weight * by_centre**2).sum(axis=1)
        both = (weight * by_centre * bell).sum(axis=1)
        amplitude = (weight * bell**2).sum(axis=1)
        return float(np.sqrt(np.mean(1.0 / (centre - both**2 / amplitude))))


SCENES = (
    Scene("clean, s = 2"),
    Scene("clean, s = 4", sigma_px=4.0),
    Scene("dim", amplitude=18.0),
    Scene("clipped", amplitude=600.0),
    Scene("speckle C = 0.2", contrast=0.2),
    Scene("speckle C = 0.3", contrast=0.3),
)


def step_pair(seed: int) -> tuple[Image, Image, Floats, NDArray[np.intp]]:
    """A stripe that jumps in depth: lit and dark picture, centre (L,), and the lines (S,) that start a jump.

    Every picture row sees one depth only, as through a good lens; speckle C = 0.1.
    """
    rng = np.random.default_rng(seed)
    scene = Scene("steps", contrast=0.1, lines=600)
    steps = np.arange(40, scene.lines, 40)
    jumps = rng.choice([-1.0, 1.0], len(steps)) * rng.uniform(1.0, 25.0, len(steps))
    offset = np.concatenate([[0.0], jumps * (np.arange(len(steps)) % 2 == 0)])
    truth = scene.truth() + offset[np.searchsorted(steps, np.arange(scene.lines), side="right")]
    lit, dark = scene.pair(seed, truth)
    return lit, dark, truth, steps
