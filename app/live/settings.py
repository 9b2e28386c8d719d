"""What a live picture shows, changed while people look."""

import math
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any, Literal, Self, TypeAlias, get_args

from app.errors import OptionError
from app.scanning.sources import scan_detector
from app.vision.polygon import MOST_CORNERS, Polygon, is_polygon
from app.vision.stripe import STRIPE_DETECTORS, StripeDetector, usual_threshold

Channel: TypeAlias = Literal["red", "green", "blue", "any", "difference"]

_HINT = "Choose another value."
_USUAL_THRESHOLD = 20.0
_WIDTHS = (240, 320, 480, 640, 800, 960, 1280, 1600, 1920, 2560, 3840)


class Kind(StrEnum):
    """The kinds of live picture."""

    RAW = "raw"
    MASK = "mask"
    OVERLAY = "overlay"
    STRIPE = "stripe"


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """One set for all viewers.

    Attributes:
        detector: name of the stripe detector.
        threshold: a peak is no stripe, and a pixel not lit, below this height, grey levels; None for the
            detector's own.
        channel: colour in which the laser is looked for; `difference` takes its own colour less the last
            picture without laser; None for the laser's own colour.
        laser: only this one; None for all that are lit.
        line_step: the stripe is looked for on every so-manieth line; more than 1 saves a slow machine work.
        quality: of JPEG made here, 1..100.
        width: columns of pictures at most, for viewers that ask for none; None for all there are.
        shows_board: whether the calibration board is looked for and painted.
        shows_markers: the same for markers on the table.
        shows_region: whether the limits of what is scanned are painted.
        polygon: corners of the part of the picture in which stripes and lit pixels count, each as shares of
            the picture's width and height, 0..1; none for the whole picture.
    """

    detector: str = "zero-crossing"
    threshold: float | None = None
    channel: Channel | None = None
    laser: str | None = None
    line_step: int = 1
    quality: int = 70
    width: int | None = None
    shows_board: bool = True
    shows_markers: bool = True
    shows_region: bool = True
    polygon: Polygon = ()

    def changed(self, lasers: tuple[str, ...], **changes: Any) -> Self:
        """With other values, each checked.

        Args:
            lasers: names that exist.
            changes: by the names of the attributes.

        Raises:
            OptionError: naming the setting.
        """
        known = [field.name for field in fields(self)]
        for name, value in changes.items():
            if name not in known:
                raise OptionError(
                    f"Live pictures have no setting {name!r}.", f"Known are: {', '.join(known)}."
                )
            _CHECKS.get(name, _is_flag)(name, value)
        if "polygon" in changes:
            changes["polygon"] = tuple((float(u), float(v)) for u, v in changes["polygon"])
        new = replace(self, **changes)
        if new.laser is not None and new.laser not in lasers:
            there = ", ".join(lasers) or "none"
            raise OptionError(f"laser: there is no laser called {new.laser!r}.", f"There are: {there}.")
        return new

    def make_detector(self) -> StripeDetector:
        """As a scan uses it, at this threshold."""
        return scan_detector(self.detector, self.threshold)

    @property
    def level(self) -> float:
        """The threshold in force, grey levels."""
        if self.threshold is not None:
            return self.threshold
        own = usual_threshold(self.detector)
        return _USUAL_THRESHOLD if own is None else own


def usual_width(name: str, width: object) -> int | None:
    """The next larger of a few widths, so that many different phones make few different pictures.

    Raises:
        OptionError: it is no width; the message begins with `name`.
    """
    _is_width(name, width)
    if not isinstance(width, int):
        return None
    return next((usual for usual in _WIDTHS if usual >= width), None)


def _is_detector(name: str, value: object) -> None:
    known = list(STRIPE_DETECTORS)
    if value not in known:
        raise OptionError(
            f"{name}: there is no stripe detector called {value!r}.", f"Choose one of: {', '.join(known)}."
        )


def _is_threshold(name: str, value: object) -> None:
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise OptionError(f"{name}: must be a number of grey levels, not {value!r}.", _HINT)
    if not 1.0 <= value <= 254.0:
        raise OptionError(f"{name}: cannot be {value:g}.", "Give 1 to 254 grey levels.")


def _is_channel(name: str, value: object) -> None:
    known = get_args(Channel)
    if value is not None and value not in known:
        raise OptionError(f"{name}: there is no channel {value!r}.", f"Choose one of: {', '.join(known)}.")


def _is_name(name: str, value: object) -> None:
    if value is not None and not isinstance(value, str):
        raise OptionError(f"{name}: must be the name of a laser, not {value!r}.", _HINT)


def _is_quality(name: str, value: object) -> None:
    _is_whole(name, value, 1, 100)


def _is_step(name: str, value: object) -> None:
    _is_whole(name, value, 1, 8)


def _is_width(name: str, value: object) -> None:
    if value is not None:
        _is_whole(name, value, 16, 10_000)


def _is_whole(name: str, value: object, lowest: int, highest: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
        raise OptionError(f"{name}: cannot be {value!r}.", f"Give a whole number from {lowest} to {highest}.")


def _is_polygon(name: str, value: object) -> None:
    if not is_polygon(value):
        raise OptionError(
            f"{name}: is no part of the picture.",
            f"Give three to {MOST_CORNERS} corners as shares of width and height, each from 0 to 1.",
        )


def _is_flag(name: str, value: object) -> None:
    if not isinstance(value, bool):
        raise OptionError(f"{name}: must be true or false, not {value!r}.", _HINT)


_CHECKS = {
    "detector": _is_detector,
    "threshold": _is_threshold,
    "channel": _is_channel,
    "laser": _is_name,
    "line_step": _is_step,
    "quality": _is_quality,
    "width": _is_width,
    "polygon": _is_polygon,
}
