"""From the pictures of one stop to stripes, marker corners and colours: the part that runs in threads."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.errors import ReconstructionError
from app.geometry.platter import SeenMarkers
from app.geometry.rig import Rig
from app.recording.shot import Shot
from app.scanning.background import Background
from app.scanning.exposures import combine_exposures
from app.scanning.facing import LaserSides, stripe_orientation
from app.scanning.stops import LitView, Stop, Texture
from app.vision.markers import PlatterSpec, detect_markers
from app.vision.polygon import Polygon, polygon_mask, stripe_inside
from app.vision.stripe import LaserColour, LaserStripe, LaserView, Orientation, StripeDetector


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """What one stop showed.

    Attributes:
        number: of the stop.
        names: files of its frames.
        turn_rad: nominal angle.
        stripes: every stripe with its laser.
        found: how many points each of them had before the background was taken out, in the whole picture.
        markers: corners of the markers on the table.
        texture: colour picture of this stop or the nearest.
    """

    number: int
    names: tuple[str, ...]
    turn_rad: float
    stripes: tuple[tuple[str, LaserStripe], ...]
    found: tuple[int, ...]
    markers: SeenMarkers
    texture: Texture[Shot] | None


@dataclass(frozen=True, eq=False, slots=True)
class Observer:
    """Finds what there is to find in the frames of a stop.

    Attributes:
        rig: the calibrated scanner.
        detector: finds one stripe in one view.
        colours: of the lasers, by name.
        platter: markers to look for; None for none.
        background: the empty scene.
        inside: pixels (H, W) on which stripes count; None for all.
    """

    rig: Rig
    detector: StripeDetector
    colours: Mapping[str, LaserColour]
    platter: PlatterSpec | None
    background: Background
    orientations: Mapping[str, Orientation]
    inside: NDArray[np.bool_] | None = None
    sides: dict[tuple[str, ...], LaserSides] = field(default_factory=dict)

    def observe(self, stop: Stop[Shot]) -> Sighting:
        """Stripes, markers and colours of one stop.

        Raises:
            ReconstructionError: a lit laser is not calibrated, or a picture has another size.
        """
        names = tuple(frame.name for frame in stop.frames)
        seen = [pair for view in stop.views for pair in self.stripes(view)]
        stripes = tuple(
            (laser, self.background.without(laser, self._inside(stripe), self.orientations[laser]))
            for laser, stripe in seen
        )
        found = tuple(len(stripe) for _, stripe in seen)
        return Sighting(stop.number, names, stop.turn_rad, stripes, found, self._markers(stop), stop.texture)

    def _inside(self, stripe: LaserStripe) -> LaserStripe:
        return stripe if self.inside is None else stripe_inside(stripe, self.inside)

    def stripes(self, view: LitView[Shot]) -> list[tuple[str, LaserStripe]]:
        """The stripe of every laser that is lit in a view."""
        for pair in view.exposures:
            check_size(self.rig, pair.lit)
        for laser in view.lasers:
            if laser not in self.rig.lasers:
                raise unknown_laser(laser, self.rig)
        return [(laser, self._stripe(view, laser)) for laser in view.lasers]

    def _stripe(self, view: LitView[Shot], laser: str) -> LaserStripe:
        orientation = self.orientations[laser]
        found = []
        for pair in view.exposures:
            dark = None if pair.dark is None else pair.dark.image
            look = LaserView(pair.lit.image, dark, self.colours.get(laser, "any"), orientation)
            if len(view.lasers) == 1:
                found.append(self.detector.detect(look))
            else:
                sides = self._sides(view.lasers)
                found.append(sides.only(laser, self.detector.detect(sides.view_of(laser, look)), orientation))
        return combine_exposures(found, orientation)

    def _sides(self, lasers: tuple[str, ...]) -> LaserSides:
        # Two threads may compute the same one at first; either result will do.
        if lasers not in self.sides:
            self.sides[lasers] = LaserSides.of(self.rig, lasers)
        return self.sides[lasers]

    def _markers(self, stop: Stop[Shot]) -> SeenMarkers:
        """Of the first frame that shows all of them, else of the one that shows most."""
        if self.platter is None:
            return {}
        best: SeenMarkers = {}
        for frame in stop.frames:
            seen = seen_markers(frame, self.platter)
            if len(seen) > len(best):
                best = seen
            if len(best) == len(self.platter.ids):
                break
        return best


def observer_for(
    rig: Rig,
    detector: StripeDetector,
    colours: Mapping[str, LaserColour],
    platter: PlatterSpec | None,
    polygon: Polygon = (),
) -> Observer:
    """An observer of a scene without background frames, of the part of the picture in a polygon, if any."""
    orientations = {laser: stripe_orientation(rig, laser) for laser in rig.lasers}
    inside = polygon_mask(polygon, rig.camera.size) if polygon else None
    return Observer(rig, detector, colours, platter, Background({}), orientations, inside)


def seen_markers(shot: Shot, platter: PlatterSpec) -> SeenMarkers:
    """Corners of the platter's own markers in one picture."""
    seen = detect_markers(shot.image, platter)
    return {int(number): corners for number, corners in zip(seen.ids, seen.corners, strict=True)}


def check_size(rig: Rig, shot: Shot) -> None:
    height, width = shot.image.shape[:2]
    if (width, height) != rig.camera.size:
        raise wrong_size((width, height), rig)


def wrong_size(size: tuple[int, int], rig: Rig) -> ReconstructionError:
    (width, height), (known_width, known_height) = size, rig.camera.size
    return ReconstructionError(
        f"The pictures are {width} x {height}, but the calibration is for {known_width} x {known_height}.",
        "Calibrate with pictures of this size, or name the calibration that belongs to this camera mode.",
    )


def unknown_laser(laser: str, rig: Rig) -> ReconstructionError:
    known = ", ".join(repr(name) for name in sorted(rig.lasers))
    return ReconstructionError(
        f"The calibration has no laser {laser!r}; it knows {known}.",
        "Name the laser in recording.json as the calibration does, or calibrate with this laser.",
    )
