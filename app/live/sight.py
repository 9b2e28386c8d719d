"""What one frame shows, computed when it is first wanted and once for all kinds of picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.devices.frame import Frame
from app.live.dark import DarkReference
from app.live.known import Known
from app.live.picture import LiveNumbers, NamedStripe
from app.live.settings import LiveSettings
from app.vision.polygon import polygon_mask, stripe_inside
from app.vision.stripe import Image, LaserColour, LaserStripe, LaserView, Orientation
from app.vision.threshold import laser_mask, laser_response

_BINS = 64
_HISTOGRAM_STEP = 4


@dataclass(frozen=True, slots=True)
class _Look:
    """Lasers that are found in one go: of one colour and one direction."""

    colour: LaserColour
    orientation: Orientation
    lasers: tuple[str, ...]


# No slots: everything is kept once it is computed. One thread only.
@dataclass(frozen=True, eq=False)
class Sight:
    """A frame and what is wanted of it.

    Attributes:
        frame: as it came.
        settings: in force.
        known: of the scanner.
        lit: names of the lasers that are on.
        dark: for differences.
    """

    frame: Frame
    settings: LiveSettings
    known: Known
    lit: Sequence[str]
    dark: DarkReference

    @cached_property
    def image(self) -> Image:
        """The pixels. Raises DeviceError as `Frame.image`."""
        return self.frame.image()

    @cached_property
    def stripes(self) -> tuple[NamedStripe, ...]:
        """Of the lasers that are on, or of the one that is asked for."""
        wanted = self.settings.laser
        names = [name for name in self.known.colours if name in self.lit or name == wanted]
        detector = self.settings.make_detector()
        found = []
        for look in self._looks(names if self.known.colours else [""]):
            ordered = self.known.in_order(look.lasers)
            several = detector.detect_several(self._thinned(self._view(look)), len(look.lasers))
            found += [
                NamedStripe(name, self._kept(self._spread(stripe, look.orientation)), look.orientation)
                for name, stripe in zip(ordered, several, strict=True)
                if wanted in (None, name) or not name
            ]
        return tuple(found)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Which pixels (H, W) are lit: the paper's thresholded picture.

        Where no laser is on, what the threshold lets through of the room: that must be nothing.
        """
        wanted = self.settings.laser
        names = [wanted] if wanted is not None else [name for name in self.known.colours if name in self.lit]
        looks = self._looks(names or list(self.known.colours) or [""])
        masks = [laser_mask(laser_response(self._view(look)), self.settings.level) for look in looks]
        merged: NDArray[np.bool_] = np.logical_or.reduce(masks)
        return merged if self._inside is None else merged & self._inside

    @cached_property
    def numbers(self) -> LiveNumbers:
        stripes = [each.stripe for each in self.stripes]
        return LiveNumbers(
            sum(len(stripe) for stripe in stripes),
            sum(int(np.count_nonzero(stripe.saturated)) for stripe in stripes),
            _focus(self.image),
            _histogram(self.image),
            self.frame.exposure_us,
        )

    @property
    def captions(self) -> tuple[str, ...]:
        """What the stripes are like, in words."""
        words = []
        for each in self.stripes:
            clipped = int(np.count_nonzero(each.stripe.saturated))
            name = each.laser or "stripe"
            words.append(f"{name}: {len(each.stripe)} rows" + (f", {clipped} clipped" if clipped else ""))
        return tuple(words) or ("no laser on",)

    def _looks(self, names: Sequence[str]) -> list[_Look]:
        groups: dict[tuple[LaserColour, Orientation], list[str]] = {}
        for name in names:
            colour: LaserColour = self.known.colours.get(name, "any")
            if self.settings.channel is not None and self.settings.channel != "difference":
                colour = self.settings.channel
            groups.setdefault((colour, self.known.orientation(name)), []).append(name)
        return [_Look(*what, tuple(lasers)) for what, lasers in groups.items()]

    def _view(self, look: _Look) -> LaserView:
        return LaserView(self.image, self._dark_image, look.colour, look.orientation)

    def _thinned(self, view: LaserView) -> LaserView:
        """Every so-manieth line of a view."""
        step = self.settings.line_step
        if step == 1:
            return view
        which = np.s_[::step] if view.orientation == "vertical" else np.s_[:, ::step]
        dark = None if view.dark is None else view.dark[which]
        return LaserView(view.lit[which], dark, view.colour, view.orientation)

    def _spread(self, stripe: LaserStripe, orientation: Orientation) -> LaserStripe:
        """A stripe of such a view, in pixels of the whole picture."""
        step = self.settings.line_step
        if step == 1:
            return stripe
        scale = np.array([1, step] if orientation == "vertical" else [step, 1])
        return replace(stripe, pixels=stripe.pixels * scale, line=stripe.line * step)

    @cached_property
    def _inside(self) -> NDArray[np.bool_] | None:
        """Which pixels (H, W) lie in the polygon of interest; None for all."""
        if not self.settings.polygon:
            return None
        height, width = self.image.shape[:2]
        return polygon_mask(self.settings.polygon, (width, height))

    def _kept(self, stripe: LaserStripe) -> LaserStripe:
        """What of a stripe lies in the polygon of interest."""
        return stripe if self._inside is None else stripe_inside(stripe, self._inside)

    @cached_property
    def _dark_image(self) -> Image | None:
        if self.settings.channel != "difference":
            return None
        partner = self.dark.partner(self.frame)
        return None if partner is None else partner.image()


def _focus(image: Image) -> float:
    """Of the middle of the picture, half as wide and high."""
    height, width = image.shape[:2]
    middle = image[height // 4 : height - height // 4, width // 4 : width - width // 4]
    grey = cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY) if middle.ndim == 3 else middle
    _, deviation = cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_16S))
    return float(deviation[0, 0] ** 2)


def _histogram(image: Image) -> tuple[float, ...]:
    share = 1.0 / _HISTOGRAM_STEP
    sample = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_NEAREST)
    grey = cv2.cvtColor(sample, cv2.COLOR_BGR2GRAY) if sample.ndim == 3 else sample
    counts = np.bincount(np.asarray(grey, np.uint8).ravel() >> 2, minlength=_BINS)
    return tuple(float(share) for share in counts / counts.sum())
