"""Shots to profiles: one pass over the stops of the table, in bounded memory."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Generic

import numpy as np

from app.errors import FrameError, ReconstructionError
from app.geometry.cloud import PointCloud
from app.geometry.rig import Triangulator
from app.recording.shot import Shot
from app.scanning.agreement import LaserAgreement, agreement
from app.scanning.angles import AngleReader
from app.scanning.colour import colours_at_angle, colours_here, colours_of_strength
from app.scanning.drift import DriftLevel, DriftReference, find_drift
from app.scanning.normals import normals_of
from app.scanning.observe import Observer, Sighting
from app.scanning.pipeline import ordered_map
from app.scanning.profile import Profile, Slice, triangulated, without_scraps
from app.scanning.quality import quality_of
from app.scanning.region import Region
from app.scanning.report import ReconstructionReport, SkippedFrame
from app.scanning.sample import Sample
from app.scanning.stops import Stop, T
from app.scanning.table import REACH_MM, TableCheck, check_by_points
from app.vision.polygon import Polygon
from app.vision.stripe import LaserColour, LaserStripe

# A stripe shorter than this, in every frame, is no stripe.
_SHORTEST_STRIPE = 8
_TABLE_POINTS = 100_000
_TABLE_POINTS_EACH = 40_000
_COMPARED_POINTS = 60_000
_MISPLACED_PX = 1.5
_DISAGREEMENT_MM = 0.15
_SKIPPED_TOLD = 3


@dataclass(frozen=True, slots=True)
class ReconstructionOptions:
    """How a recording becomes points.

    Attributes:
        radius_mm: points further from the axis are left out; None for what `default_region` says.
        above_mm, below_mm: heights over the table between which points are kept; None likewise.
        min_quality: points of lower quality are left out.
        shortest_piece: unbroken pieces of stripe with fewer points than this are taken for noise.
        with_colour: colour pictures are decoded and used.
        uses_markers: markers on the table tell the angle, where there are any.
        threshold: for whoever makes the detector, see `scan_detector`.
        channel: in which all lasers are looked for; None for each one's own colour.
        polygon: part of the picture in which stripes count; none for all of it.
        skips_bad_frames: a stop with an unreadable frame is left out and reported instead of ending the run.
        workers: threads that decode and detect.
        ahead: how many stops may wait for their turn; 0 for a live scan.
        is_prompt: no profile waits for the next one: its normals come from the one before.
    """

    radius_mm: float | None = None
    above_mm: float | None = None
    below_mm: float | None = None
    min_quality: float = 0.0
    shortest_piece: int = 5
    with_colour: bool = True
    uses_markers: bool = True
    threshold: float | None = None
    channel: LaserColour | None = None
    polygon: Polygon = ()
    skips_bad_frames: bool = False
    workers: int = 2
    ahead: int = 2
    is_prompt: bool = False


class Reconstruction(Generic[T]):
    """One run: iterate over its profiles once, then ask for the report.

    A profile follows its stop by one, because its normals need the neighbour, unless it is to be prompt.

    Args:
        stops: what was taken, from a disk or from hardware.
        load: decodes the frames of a stop; called in threads.
        observer: finds the stripes.
        angles: tells the true angles.
        region: what is kept.
        options: see there.
        total: how many profiles there will be; 0 where nobody knows.
        tables: checks of the table that were made beforehand.
        warnings: what is known beforehand.
        reference: what the table looked like when the scanner was calibrated.
    """

    def __init__(
        self,
        stops: Iterable[Stop[T]],
        load: Callable[[Stop[T]], Stop[Shot]],
        observer: Observer,
        angles: AngleReader,
        region: Region,
        options: ReconstructionOptions,
        *,
        total: int = 0,
        tables: tuple[TableCheck, ...] = (),
        warnings: tuple[str, ...] = (),
        reference: DriftReference | None = None,
    ) -> None:
        self.region, self.total = region, total
        self.laser_names = tuple(observer.rig.lasers)
        self._stops, self._load, self._observer, self._angles = stops, load, observer, angles
        self._options, self._tables, self._warnings = options, tables, warnings
        self._reference = reference
        self._triangulator = Triangulator.of(observer.rig)
        self._waiting: dict[str, tuple[Slice | None, Slice]] = {}
        self._longest: dict[str, int] = {}
        self._skipped: list[SkippedFrame] = []
        self._points = self._profiles = self._outside = 0
        self._near_table = Sample(3, _TABLE_POINTS)
        self._near_by_laser = {laser: Sample(3, _TABLE_POINTS_EACH) for laser in self.laser_names}
        self._compared = {laser: Sample(6, _COMPARED_POINTS) for laser in self.laser_names}

    def __iter__(self) -> Iterator[Profile]:
        """Every profile, in the order of the stops for each laser; some may be empty.

        Raises:
            FrameError: a picture cannot be read.
            ReconstructionError: nothing was found, or a laser never.
        """
        for sighting in ordered_map(self._observe, self._stops, self._options.workers, self._options.ahead):
            if isinstance(sighting, SkippedFrame):
                self._skipped.append(sighting)
                continue
            angle = self._angles.read(sighting.turn_rad, sighting.markers)
            for (laser, stripe), found in zip(sighting.stripes, sighting.found, strict=True):
                self._longest[laser] = max(self._longest.get(laser, 0), found)
                if not found:
                    self._skipped.append(
                        SkippedFrame(_first(sighting.names), f"shows no stripe of laser {laser!r}")
                    )
                before, here = self._waiting.get(laser, (None, None))
                part = self._sliced(sighting, laser, stripe, angle)
                if self._options.is_prompt:
                    yield self._finished(here, part, None)
                elif here is not None:
                    yield self._finished(before, here, part)
                self._waiting[laser] = (here, part)
        if not self._options.is_prompt:
            for before, here in self._waiting.values():
                yield self._finished(before, here, None)
        self._waiting.clear()
        self._check_result()

    def report(self) -> ReconstructionReport:
        """What the run has to say; complete after the last profile."""
        angles = self._angles.summary()
        agreements = self._agreements()
        tables = list(self._tables)
        by_laser: dict[str, TableCheck] = {}
        if np.isfinite(self._observer.rig.axis.offset_mm):
            seen = check_by_points(self._near_table.rows)
            tables += [] if seen is None else [seen]
            checks = {laser: check_by_points(near.rows) for laser, near in self._near_by_laser.items()}
            by_laser = {laser: check for laser, check in checks.items() if check is not None}
        now = DriftReference({laser: seen.offset_mm for laser, seen in by_laser.items()})
        drift = find_drift(by_laser, agreements, angles.marker_rms_px, self._reference)
        doubts: list[str] = []
        if angles.marker_rms_px > _MISPLACED_PX:
            doubts.append(
                f"The markers on the table are seen {angles.marker_rms_px:.1f} px from where they should be: "
                "the camera or the table was moved since the calibration; calibrate again."
            )
        doubts += [table.sentence for table in tables if table.sentence]
        doubts += [
            f"Lasers {pair.first!r} and {pair.second!r} disagree by {pair.disagreement_mm:.2f} mm: "
            "one of them was moved since the calibration, or the axis is off; calibrate again."
            for pair in agreements
            if pair.disagreement_mm > _DISAGREEMENT_MM
        ]
        if drift.level is DriftLevel.DRIFTED and drift.findings[0].name != "markers":
            doubts = [*drift.sentences, *doubts]
        warnings = [*self._warnings]
        warnings += drift.sentences if drift.level is DriftLevel.WATCH else ()
        warnings += [angles.sentence] if angles.sentence else []
        warnings += _told(self._skipped)
        return ReconstructionReport(
            self._points, self._profiles, self._outside, tuple(self._skipped), angles, agreements,
            tuple(tables), drift, now, tuple(warnings), tuple(doubts),
        )  # fmt: skip

    def _observe(self, stop: Stop[T]) -> Sighting | SkippedFrame:
        try:
            return self._observer.observe(self._load(stop))
        except FrameError as error:
            if not self._options.skips_bad_frames:
                raise
            return SkippedFrame(error.where, error.problem)

    def _sliced(self, sighting: Sighting, laser: str, stripe: LaserStripe, angle: float) -> Slice:
        orientation = self._observer.orientations[laser]
        stripe = without_scraps(stripe, self._options.shortest_piece)
        stripe, points, sigma = triangulated(self._triangulator, laser, angle, stripe, orientation)
        texture = sighting.texture
        if texture is None:
            colours = colours_of_strength(stripe)
        elif texture.is_here:
            colours = colours_here(texture.frame.image, stripe.pixels)
        else:
            turned = texture.turn_rad + self._angles.offset_rad
            colours = colours_at_angle(texture.frame.image, self._observer.rig, points, turned)
        camera = self._observer.rig.axis.table_from_camera(angle).translation.astype(np.float32)
        return Slice(sighting.number, laser, angle, stripe, points, sigma, colours, camera)

    def _finished(self, before: Slice | None, here: Slice, after: Slice | None) -> Profile:
        normals = normals_of(before, here, after)
        index = self.laser_names.index(here.laser)
        n = len(here)
        cloud = PointCloud(
            here.points, normals, here.colours, here.sigma_mm, np.full(n, index, np.uint8),
            np.full(n, np.degrees(here.angle_rad) % 360.0, np.float32), quality_of(here, normals),
            self.laser_names,
        )  # fmt: skip
        near = self.region.within_radius(cloud.points) & (np.abs(cloud.points[:, 2]) < REACH_MM)
        self._near_table.add(cloud.points[near])
        self._near_by_laser[here.laser].add(cloud.points[near])
        inside = self.region.holds(cloud.points)
        self._outside += n - int(np.count_nonzero(inside))
        cloud = cloud.select(inside & (cloud.quality >= self._options.min_quality))
        self._compared[here.laser].add(np.hstack([cloud.points, cloud.normals]))
        self._points += len(cloud)
        self._profiles += len(cloud) > 0
        return Profile(here.number, here.laser, here.angle_rad, cloud)

    def _agreements(self) -> tuple[LaserAgreement, ...]:
        pairs = [
            agreement((a, b), self._compared[a].rows, self._compared[b].rows)
            for a, b in combinations(self.laser_names, 2)
        ]
        return tuple(pair for pair in pairs if pair is not None)

    def _check_result(self) -> None:
        _check_every_laser_seen(self._longest)
        if self._points == 0 and self._outside == 0 and self._options.polygon:
            raise ReconstructionError(
                "The part of the picture that was drawn shows no stripe.", "Draw it larger, or take it away."
            )
        if self._points == 0:
            region = self.region
            raise ReconstructionError(
                f"None of the {self._outside} points lies within {region.radius_mm:.0f} mm of the axis "
                f"between {region.lowest_mm:.0f} and {region.highest_mm:.0f} mm above the table.",
                "Widen the region, or check that the calibration belongs to this rig.",
            )


def _check_every_laser_seen(longest: Mapping[str, int]) -> None:
    if not longest:
        raise ReconstructionError("The recording has no scan frame with a laser on.")
    for laser, length in longest.items():
        if length < _SHORTEST_STRIPE:
            raise ReconstructionError(
                f"Laser {laser!r} is lit in the recording, but its stripe was never seen.",
                "Check the colour of the laser in recording.json, lower the detector's min_strength, "
                "or expose longer.",
            )


def _told(skipped: list[SkippedFrame]) -> list[str]:
    if not skipped:
        return []
    told = "; ".join(f"{frame.name} {frame.reason}" for frame in skipped[:_SKIPPED_TOLD])
    more = "" if len(skipped) <= _SKIPPED_TOLD else f"; and {len(skipped) - _SKIPPED_TOLD} more"
    return [f"{len(skipped)} frames gave no points: {told}{more}."]


def _first(names: tuple[str, ...]) -> str:
    return names[-1] if names else "a frame"
