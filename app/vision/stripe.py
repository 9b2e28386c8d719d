"""What a stripe is, and how one is asked for."""

import inspect
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats, Pixels
from app.registry import Registry

Image: TypeAlias = NDArray[np.uint8]
"""(H, W, 3) blue, green, red, or (H, W) grey."""
LaserColour: TypeAlias = Literal["red", "green", "blue", "any"]
Orientation: TypeAlias = Literal["vertical", "horizontal"]
"""Which way the stripe runs in the picture: a vertical one is looked for once in every row."""


@dataclass(frozen=True, eq=False, slots=True)
class LaserView:
    """One picture of a lit stripe, with what helps to find it.

    Attributes:
        lit: the picture with the laser on.
        dark: the same view with the laser off, where there is one.
        colour: colour of the laser; `any` uses the difference or the intensity alone.
        orientation: which way the stripe runs.
    """

    lit: Image
    dark: Image | None = None
    colour: LaserColour = "any"
    orientation: Orientation = "vertical"


@dataclass(frozen=True, eq=False, slots=True)
class LaserStripe:
    """Sub-pixel stripe centres of one picture, one for each line that crosses the stripe.

    Attributes:
        pixels: (N, 2) as (u, v), in the order of the lines.
        line: (N,) row number (column number for a horizontal stripe) of each.
        strength: (N,) height of the peak above its surroundings, grey levels.
        variance: (N,) of the position across the stripe, px^2.
        width: (N,) the stripe's sigma, px.
        second: (N,) height of the next peak of the same line as a share of this one, 0..1.
        segment: (N,) number of the unbroken piece of stripe it belongs to.
        saturated: (N,) whether the core of the stripe is clipped.
    """

    pixels: Pixels
    line: NDArray[np.intp]
    strength: Floats
    variance: Floats
    width: Floats
    second: Floats
    segment: NDArray[np.intp]
    saturated: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.pixels)

    @classmethod
    def empty(cls) -> "LaserStripe":
        none, whole = np.zeros(0), np.zeros(0, np.intp)
        return cls(np.zeros((0, 2)), whole, none, none, none, none, whole, np.zeros(0, np.bool_))

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "LaserStripe":
        """The points of a mask or index array."""
        return LaserStripe(
            self.pixels[which], self.line[which], self.strength[which], self.variance[which],
            self.width[which], self.second[which], self.segment[which], self.saturated[which],
        )  # fmt: skip


class StripeDetector(Protocol):
    """A way of finding the stripe."""

    def detect(self, view: LaserView) -> LaserStripe:
        """The stripe of one picture; empty where there is none."""
        ...

    def detect_several(self, view: LaserView, count: int) -> list[LaserStripe]:
        """`count` stripes of one picture with several lasers lit, in the order in which they lie across.

        Left to right for vertical stripes, top to bottom for horizontal ones. On a line that shows fewer,
        each peak goes to the stripe that is nearest on the nearest line that shows all.
        """
        ...


STRIPE_DETECTORS: Registry[StripeDetector] = Registry("stripe detector", "app.vision.detectors")


def usual_threshold(name: str) -> float | None:
    """Below how many grey levels a detector takes a peak for noise; None where it takes no threshold.

    Raises:
        OptionError: there is no such detector.
    """
    taken = inspect.signature(STRIPE_DETECTORS.maker(name)).parameters.get("min_strength")
    return None if taken is None else float(taken.default)
