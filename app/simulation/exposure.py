"""What a camera's controls make of the light."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.simulation.noise import Noise

STANDARD_EXPOSURE_US = 8000.0
_NEUTRAL_KELVIN = 5000.0
_WARMTH = 0.6
_SHARP_FOCUS = 60.0
_BLUR_PX_PER_FOCUS = 0.06


@dataclass(frozen=True, slots=True)
class Exposure:
    """How much light a picture gathers, against what the scene says.

    Attributes:
        room: of the room's light.
        lasers: of each laser's, by name; 1 for those that are not named.
        colour: what the camera makes of blue, green and red.
        gain: amplification of the sensor, part of `room` and `lasers` already; noise grows with it.
    """

    room: float = 1.0
    lasers: Mapping[str, float] = field(default_factory=dict)
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gain: float = 1.0

    def noisy(self, noise: Noise) -> Noise:
        """A sensor's noise at this gain: as many electrons make more grey levels."""
        return Noise(noise.speckle, noise.electrons_per_grey / self.gain, noise.read_grey * self.gain)


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """The controls of the simulated camera; with those here the picture is as the scene says.

    Attributes:
        exposure_us: how long light is gathered.
        gain: amplification.
        white_balance_k: colour of the light that the camera takes for white.
        focus: the camera's own scale, 0..255.
    """

    exposure_us: float = STANDARD_EXPOSURE_US
    gain: float = 1.0
    white_balance_k: float = _NEUTRAL_KELVIN
    focus: float = _SHARP_FOCUS

    def exposure(self, room: float, lasers: Mapping[str, float]) -> Exposure:
        """What a picture gathers in a room so bright, with each laser lit for a share of the time."""
        factor = self.gain * self.exposure_us / STANDARD_EXPOSURE_US
        warmer = (self.white_balance_k / _NEUTRAL_KELVIN) ** _WARMTH
        lit = {name: factor * share for name, share in lasers.items()}
        return Exposure(factor * room, lit, (1.0 / warmer, 1.0, warmer), self.gain)

    def blur_px(self, lens_blur_px: float) -> float:
        """Sigma of a point's picture, out of focus or not."""
        off = _BLUR_PX_PER_FOCUS * (self.focus - _SHARP_FOCUS)
        return float((lens_blur_px**2 + off**2) ** 0.5)
