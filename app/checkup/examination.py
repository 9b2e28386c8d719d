"""What the checks share: the bench, and pictures of it that are taken once."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.calibration.record import CalibrationRecord
from app.checkup.target import Corners, Target, targets_of
from app.devices.bench import Bench
from app.devices.bench_file import LaserEntry
from app.devices.frame import Frame, Use
from app.scanning.sources import scan_detector
from app.vision.stripe import Image, LaserStripe, LaserView

_PICTURE_S = 5.0
_UNTOLD_S = 0.5
_LIT_SHARE, _BACK_SHARE = 0.05, 0.5
# Two stripes in a row that lie closer than this are one.
_SAME_PX = 8.0


@dataclass(frozen=True, eq=False, slots=True)
class LaserLook:
    """One laser, switched on alone.

    Attributes:
        entry: of the bench file.
        dark: picture before, all lasers off.
        lit: with this one on.
        after: all off again.
        stripe: its light, as the scan's detector finds it.
    """

    entry: LaserEntry
    dark: Image
    lit: Image
    after: Image
    stripe: LaserStripe

    @property
    def share(self) -> float:
        """Of the picture's rows, those that show the stripe."""
        return len(self.stripe) / len(self.lit)

    @property
    def is_lit(self) -> bool:
        """Whether switching it on brought light."""
        return brings_light(self.lit, self.dark, self.entry)


@dataclass(eq=False, slots=True)
class Examination:
    """A bench that is being looked at; the caller holds its lease.

    Attributes:
        bench: connected as far as it can be.
        folder: where scans would go.
        calibration: of the bench, where there is one.
        tell: told what is being done, for whoever waits.
        patience_s: how much longer than the bench file says a picture may be under way: from a camera that
            does not tell when it exposed, until its latency has been measured.
    """

    bench: Bench
    folder: Path
    calibration: CalibrationRecord | None = None
    tell: Callable[[str], None] = lambda note: None
    patience_s: float = _UNTOLD_S
    _looks: tuple[LaserLook, ...] | None = field(default=None, init=False)
    _room: Frame | None = field(default=None, init=False)

    def picture(self, use: Use) -> Frame:
        """A fresh one, exposed for a use."""
        camera = self.bench.camera
        camera.prepare(use)
        wait_s = 0.0 if camera.facts.has_timestamps else self.patience_s
        return camera.fresh_frame(after_s=time.monotonic() + wait_s, timeout_s=_PICTURE_S + wait_s)

    @property
    def room(self) -> Frame:
        """The scene by the light of the room, lasers off."""
        if self._room is None:
            self._room = self.picture(Use.TEXTURE)
        return self._room

    @property
    def switches_lasers(self) -> bool:
        """Whether the board does; a person is too slow to be measured by, and lasers may be on for good."""
        options = self.bench.description.turntable.options
        return not (self.bench.turntable.facts.lasers_by_hand or options.get("are_lasers_always_on"))

    @property
    def looks(self) -> tuple[LaserLook, ...]:
        """Every laser of the bench file that the board switches, lit alone."""
        if self._looks is None:
            channels = self.bench.turntable.facts.laser_channels if self.switches_lasers else ()
            self._looks = tuple(
                self.look_at(name) for name, entry in self.bench.lasers.items() if entry.channel in channels
            )
        return self._looks

    def look_at(self, laser: str) -> LaserLook:
        """Switch one laser on and off, with a picture before, meanwhile and after."""
        entry = self.bench.lasers[laser]
        dark = self.picture(Use.LASER).image()
        with self.bench.lit(laser):
            lit = self.picture(Use.LASER).image()
        after = self.picture(Use.LASER).image()
        return LaserLook(entry, dark, lit, after, stripe_of(lit, dark, entry))

    def settle(self) -> None:
        """Let the table come to rest."""
        time.sleep(self.bench.description.turntable.settle_s)

    def target(self) -> tuple[Target, Corners] | None:
        """What on the table can be followed, and where it is seen now; None for nothing."""
        image = self.picture(Use.BOARD).image(grey=True)
        for target in targets_of(self.bench.description):
            corners = target.find(image)
            if corners:
                return target, corners
        return None


def brings_light(lit: Image, dark: Image, entry: LaserEntry) -> bool:
    """Whether there is a stripe in one picture more than in the other."""
    more, less = _new_rows(lit, dark, entry), _new_rows(dark, lit, entry)
    return more >= _LIT_SHARE * len(lit) and less < _BACK_SHARE * more


def _new_rows(image: Image, before: Image, entry: LaserEntry) -> int:
    """In how many rows a stripe has come where there was none.

    The speckle of a laser that is on in both makes a stripe of their difference, where it was before.
    """
    come, there = stripe_of(image, before, entry), stripe_of(before, None, entry)
    _, ours, theirs = np.intersect1d(come.line, there.line, return_indices=True)
    apart_px = np.abs(come.pixels[ours, 0] - there.pixels[theirs, 0])
    return len(come) - int(np.count_nonzero(apart_px < _SAME_PX))


def stripe_of(lit: Image, dark: Image | None, entry: LaserEntry) -> LaserStripe:
    """The stripe in a picture, one point for each row."""
    stripe = scan_detector().detect(LaserView(lit, dark, entry.colour))
    return stripe.select(np.flatnonzero(np.isfinite(stripe.pixels).all(axis=1)))
