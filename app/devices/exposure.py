"""The longest exposure that leaves the laser's stripe unclipped, found with few pictures.

The answer is bracketed by an exposure that clips too much and one that does not, on a scale of factors. The
next guess takes the stripe's light to grow with a power of the exposure, as cameras bend their response;
where that leads out of the bracket, the bracket is halved.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from app.devices.camera import Camera
from app.devices.camera_driver import Control, ControlName
from app.devices.stripe_look import StripeLook, look_at_stripe
from app.errors import DeviceError, DeviceRefused, ScannerError
from app.vision.stripe import LaserColour, LaserView, Orientation

SwitchLaser: TypeAlias = Callable[[bool], None]
"""Puts the laser on and off; it is switched when the call returns."""
Advice: TypeAlias = Literal["", "dim", "uneven"]

_WISHED_GREY = 228.0
_GOOD_GREY = 215.0
# Of the lines on which a longer exposure shows the stripe; on the others it is too weak.
_LEAST_SHARE = 0.6
_MOST_PICTURES = 12
# Cameras brighten dark parts; hardly one more than a display darkens them, which is 1 / 2.2.
_STRONGEST_BEND = 0.4
# A bracket that is narrower than this factor is good enough; for a gain, than this share of its range.
_CLOSE_ENOUGH = 1.1
_CLOSE_GAIN = 0.03
_SHORTEST_US, _LONGEST_US = 50.0, 100_000.0


@dataclass(frozen=True, slots=True)
class ExposureFound:
    """What the search came to; the camera has it already.

    Attributes:
        control: exposure, or gain for a camera without; as the camera took it.
        look: of the stripe with it.
        tried: every picture of the search, in order.
        advice: empty where all is well; `dim` where the stripe is weak even at the longest exposure; `uneven`
            where parts of it clip before the rest is strong, as on shiny things.
    """

    control: Control
    look: StripeLook
    tried: tuple[StripeLook, ...]
    advice: Advice


def find_exposure(
    camera: Camera,
    switch_laser: SwitchLaser,
    *,
    colour: LaserColour = "any",
    orientation: Orientation = "vertical",
    detector: str = "zero-crossing",
    longest_us: float | None = None,
) -> ExposureFound:
    """Search, and leave the camera with what was found and the laser off.

    Args:
        camera: connected; the scene must stand still.
        switch_laser: of the one laser that is to be exposed for.
        colour: of it.
        orientation: of its stripe.
        detector: name of the stripe detector that the scan will use.
        longest_us: no longer exposures than this; None allows one period of the camera's pictures.

    Raises:
        DeviceRefused: the camera has neither exposure nor gain to set.
        DeviceError: the stripe is clipped whatever is set, or is not seen at all. The camera has its former
            setting again.
    """
    search = _Search.of(camera, switch_laser, colour, orientation, detector, longest_us)
    before = camera.controls()[search.name]
    try:
        return search.run()
    except ScannerError:
        camera.set_control(search.name, None if before.is_automatic else before.value)
        raise
    finally:
        switch_laser(False)


@dataclass(slots=True)
class _Search:
    camera: Camera
    switch_laser: SwitchLaser
    colour: LaserColour
    orientation: Orientation
    detector: str
    name: ControlName
    lowest: float
    highest: float
    tried: list[StripeLook]
    control: Control

    @classmethod
    def of(
        cls,
        camera: Camera,
        switch_laser: SwitchLaser,
        colour: LaserColour,
        orientation: Orientation,
        detector: str,
        longest_us: float | None,
    ) -> "_Search":
        present = camera.controls()
        name = next((n for n in (ControlName.EXPOSURE, ControlName.GAIN) if n in present), None)
        if name is None:
            raise DeviceRefused(
                camera.name,
                "has neither exposure nor gain that could be set",
                "Set the exposure in the camera's own app, so that the stripe is bright but not white.",
            )
        control = present[name]
        if name is ControlName.EXPOSURE:
            fps = camera.facts.fps
            period_us = 1e6 / fps if fps > 0.0 else _LONGEST_US
            lowest = max(control.lowest or _SHORTEST_US, 1.0)
            highest = min(control.highest or _LONGEST_US, longest_us or period_us)
        else:
            lowest = control.lowest or 0.0
            highest = 255.0 if control.highest is None else control.highest
        return cls(
            camera,
            switch_laser,
            colour,
            orientation,
            detector,
            name,
            lowest,
            max(lowest, highest),
            [],
            control,
        )

    def run(self) -> ExposureFound:
        below, above = self._ends()
        while above is not None and not self._is_close(below, above) and len(self.tried) < _MOST_PICTURES:
            look = self._try(self._between(below, above))
            if not below.value < look.value < above.value:
                break
            below, above = (below, look) if look.is_clipped else (look, above)
        if self.tried[-1] is not below:
            self.control = self.camera.set_control(self.name, below.value)
        if not below.is_seen:
            raise self._unseen()
        is_whole = below.lines >= _LEAST_SHARE * max(look.lines for look in self.tried)
        advice: Advice = "dim" if above is None else "uneven"
        if below.is_strong and is_whole:
            advice = ""
        return ExposureFound(self.control, below, tuple(self.tried), advice)

    def _ends(self) -> tuple[StripeLook, StripeLook | None]:
        """The longest exposure where it does not clip, else the shortest and the longest."""
        longest = self._try(self.highest)
        if not longest.is_clipped:
            return longest, None
        shortest = self._try(self.lowest)
        if shortest.is_clipped:
            raise self._too_bright(shortest)
        return shortest, longest

    def _between(self, below: StripeLook, above: StripeLook) -> float:
        """Where the stripe would be just bright enough if it grew as so far; else the middle."""
        if self.name is ControlName.GAIN:
            return 0.5 * (below.value + above.value)
        if below.is_seen and below.bright_grey > 0.0:
            guess = below.value * math.pow(_WISHED_GREY / below.bright_grey, 1.0 / self._bend())
            if below.value * _CLOSE_ENOUGH < guess < above.value / _CLOSE_ENOUGH:
                return guess
        return math.sqrt(below.value * above.value)

    def _bend(self) -> float:
        """The power of the exposure with which the stripe's light grows, by the two best pictures so far."""
        seen = [look for look in self.tried if look.is_seen and not look.is_clipped]
        seen.sort(key=lambda look: look.value)
        if len(seen) < 2:
            return 1.0
        one, other = seen[-2:]
        if other.value < _CLOSE_ENOUGH * one.value or one.bright_grey <= 0.0:
            return 1.0
        bend: float = math.log(other.bright_grey / one.bright_grey) / math.log(other.value / one.value)
        return min(max(bend, _STRONGEST_BEND), 1.0)

    def _is_close(self, below: StripeLook, above: StripeLook) -> bool:
        if below.is_seen and below.bright_grey >= _GOOD_GREY:
            return True
        if self.name is ControlName.GAIN:
            return above.value - below.value <= _CLOSE_GAIN * (self.highest - self.lowest)
        return above.value <= _CLOSE_ENOUGH * below.value

    def _try(self, value: float) -> StripeLook:
        self.control = self.camera.set_control(self.name, value)
        self.switch_laser(True)
        lit = self.camera.fresh_frame().image()
        self.switch_laser(False)
        dark = self.camera.fresh_frame().image()
        chosen = value if self.control.value is None else self.control.value
        view = LaserView(lit, dark, self.colour, self.orientation)
        look = look_at_stripe(view, self.detector, chosen)
        self.tried.append(look)
        return look

    def _too_bright(self, shortest: StripeLook) -> DeviceError:
        what = f"even at the {self._words(shortest.value, 'shortest exposure', 'lowest gain')}"
        return DeviceError(
            self.camera.name,
            f"the stripe is clipped in {100.0 * shortest.clipped:.0f} % of its lines {what}",
            "Lower the camera's gain or brightness, close its aperture, put a grey filter before it, or dim "
            "the laser.",
        )

    def _unseen(self) -> DeviceError:
        return DeviceError(
            self.camera.name,
            "no stripe is to be seen, whatever the exposure",
            "Check that the laser is on and its stripe in the picture, put something pale on the table, and "
            "dim the room.",
        )

    def _words(self, value: float, exposure: str, gain: str) -> str:
        return f"{exposure} ({value:g} us)" if self.name is ControlName.EXPOSURE else f"{gain} ({value:g})"
