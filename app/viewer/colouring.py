"""What the colour of a point says."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.viewer.display import FULL_SHADE, DisplayPoints

ColourMode: TypeAlias = Literal["texture", "height", "laser", "quality", "angle"]
COLOUR_MODES: tuple[ColourMode, ...] = get_args(ColourMode)
Colours: TypeAlias = NDArray[np.uint8]

LASER_COLOURS = np.array(
    [[255, 92, 80], [88, 196, 255], [132, 230, 120], [255, 204, 92], [200, 140, 255], [255, 140, 200]],
    np.uint8,
)
"""One for each laser by its number, and again from the beginning."""


def _ramp(colour_map: int) -> Colours:
    levels = np.arange(256, dtype=np.uint8)[:, None]
    return np.ascontiguousarray(cv2.applyColorMap(levels, colour_map)[:, 0, ::-1])


_HEIGHTS = _ramp(cv2.COLORMAP_VIRIDIS)
_QUALITIES = _ramp(cv2.COLORMAP_TURBO)[::-1]
_ANGLES = _ramp(cv2.COLORMAP_HSV)


@dataclass(frozen=True, slots=True)
class Colouring:
    """How points are coloured.

    Attributes:
        mode: what the colour says.
        top_mm: height above the table at the end of the ramp.
    """

    mode: ColourMode = "height"
    top_mm: float = 32.0

    def colours(self, shown: DisplayPoints) -> Colours:
        """(N, 3) red, green, blue."""
        plain = _PLAIN[self.mode](shown, self.top_mm)
        if self.mode == "texture":
            return plain
        lit = plain.astype(np.uint16) * shown.shade[:, None] // FULL_SHADE
        colours: Colours = np.minimum(lit, 255).astype(np.uint8)
        return colours


def colour_mode(name: str) -> ColourMode:
    """The mode of that name. Raises OptionError where there is none."""
    for mode in COLOUR_MODES:
        if mode == name:
            return mode
    raise OptionError(f"Points cannot be coloured by {name!r}.", f"Choose one of: {', '.join(COLOUR_MODES)}.")


def _height(shown: DisplayPoints, top_mm: float) -> Colours:
    level = np.clip(shown.points[:, 2] * (255.0 / top_mm), 0.0, 255.0)
    colours: Colours = _HEIGHTS[level.astype(np.uint8)]
    return colours


_PLAIN: dict[ColourMode, Callable[[DisplayPoints, float], Colours]] = {
    "texture": lambda shown, _: shown.texture,
    "height": _height,
    "laser": lambda shown, _: LASER_COLOURS[shown.laser % len(LASER_COLOURS)],
    "quality": lambda shown, _: _QUALITIES[shown.quality],
    "angle": lambda shown, _: _ANGLES[shown.turn],
}
