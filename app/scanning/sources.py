"""Where the stops come from: a recording on disk, or shots as they are taken."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from app.errors import ReconstructionError
from app.geometry.platter import MarkerLayout, SeenMarkers, angle_from_markers, solve_layout
from app.geometry.rig import Rig
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.scanning.angles import AngleReader, NominalAngles
from app.scanning.background import Background
from app.scanning.drift import DriftReference
from app.scanning.frames import StopLoader
from app.scanning.observe import Observer, observer_for, seen_markers, unknown_laser, wrong_size
from app.scanning.pipeline import ordered_map
from app.scanning.reconstruct import Reconstruction, ReconstructionOptions
from app.scanning.region import Region, default_region
from app.scanning.stops import LitPair, LitView, Stop, stops_of_shots
from app.scanning.table import TableCheck, check_by_markers
from app.vision.markers import PlatterSpec
from app.vision.stripe import STRIPE_DETECTORS, LaserColour, LaserStripe, StripeDetector, usual_threshold

_SMOOTH_ROWS = 7
# Pictures from which the layout of the markers is solved, at most.
_LAYOUT_VIEWS = 120
_LAYOUT_WORST_PX = 3.0


def scan_detector(name: str = "zero-crossing", threshold: float | None = None) -> StripeDetector:
    """The detector a scan uses: smoothed over seven lines inside every unbroken piece of stripe.

    Args:
        name: of the detector.
        threshold: a peak is no stripe below this height, grey levels; None for the detector's own. One that
            takes none does without.
    """
    options: dict[str, object] = {}
    if name == "zero-crossing":
        options["smooth_rows"] = _SMOOTH_ROWS
    if threshold is not None and usual_threshold(name) is not None:
        options["min_strength"] = threshold
    return STRIPE_DETECTORS.make(name, **options)


def reconstruct_recording(
    recording: Recording,
    rig: Rig,
    detector: StripeDetector,
    options: ReconstructionOptions | None = None,
    layout: MarkerLayout | None = None,
    reference: DriftReference | None = None,
) -> Reconstruction[FrameEntry]:
    """Everything a recording holds, as profiles; the frames are read while these are asked for.

    Args:
        recording: with scan frames.
        rig: its calibration.
        detector: finds the stripe, see `scan_detector`.
        options: see there.
        layout: where the markers on the table lie, where a calibration knows; else it is solved from the
            recording itself.
        reference: what the table looked like when the scanner was calibrated, to tell what has changed.

    Raises:
        ReconstructionError: the calibration does not belong to the recording, or an angle is missing.
        FrameError: a background frame or one with markers cannot be read.
    """
    options = options or ReconstructionOptions()
    _check_fits(recording, rig)
    loader = StopLoader(recording, with_colour=options.with_colour)
    stops = loader.stops()
    if not stops:
        raise ReconstructionError(f"{recording.folder} has no scan frame with a laser on.")
    platter = recording.platter if options.uses_markers else None
    observer = _observer(rig, detector, recording.lasers, platter, options)
    observer = replace(observer, background=_background(recording, observer))
    offset, tables, warnings = 0.0, list[TableCheck](), list[str]()
    if platter is not None:
        views, turns = _marker_views(recording, stops, platter, options.workers)
        if layout is None:
            layout, tables, warnings = _solved_layout(rig, views, turns)
        offset = _first_offset(rig, layout, views, turns)
    direction = 1.0 if recording.turn_rad(1.0) > 0.0 else -1.0
    angles = AngleReader(rig, layout or {}, _nominal(recording, stops), offset, direction)
    return Reconstruction(
        stops, loader.load, observer, angles, _region(rig, options, layout),
        options, total=_profiles(stops), tables=tuple(tables), warnings=tuple(warnings),
        reference=reference,
    )  # fmt: skip


def reconstruct_shots(
    shots: Iterable[Shot],
    rig: Rig,
    detector: StripeDetector,
    colours: Mapping[str, LaserColour],
    turn_rad: Callable[[float], float],
    options: ReconstructionOptions | None = None,
    platter: PlatterSpec | None = None,
    layout: MarkerLayout | None = None,
    *,
    each_alone: bool = False,
) -> Reconstruction[Shot]:
    """Shots as they are taken, as profiles; nothing is kept but what the next profile needs.

    Args:
        shots: in the order they were taken, frames of one stop together.
        rig: the calibrated scanner.
        detector: finds the stripe.
        colours: of the lasers, by name.
        turn_rad: the shots' `angle_deg` as a right-handed turn about the upward axis.
        options: `ahead=0` gives every profile as early as it can be had.
        platter, layout: markers on the table and where they lie; both are needed for them to be used.
        each_alone: no two shots show the same stop, see `stops_of_shots`.
    """
    options = options or ReconstructionOptions(ahead=0)
    used = platter if options.uses_markers and layout else None
    return Reconstruction(
        stops_of_shots(shots, turn_rad, each_alone=each_alone), _as_they_are,
        _observer(rig, detector, colours, used, options),
        AngleReader(rig, (layout or {}) if used else {}), _region(rig, options, layout), options,
    )  # fmt: skip


def _observer(
    rig: Rig,
    detector: StripeDetector,
    colours: Mapping[str, LaserColour],
    platter: PlatterSpec | None,
    options: ReconstructionOptions,
) -> Observer:
    if options.channel is not None:
        colours = dict.fromkeys(colours, options.channel)
    return observer_for(rig, detector, colours, platter, options.polygon)


def _profiles(stops: list[Stop[FrameEntry]]) -> int:
    return sum(len(view.lasers) for stop in stops for view in stop.views)


def _as_they_are(stop: Stop[Shot]) -> Stop[Shot]:
    return stop


def _region(rig: Rig, options: ReconstructionOptions, layout: MarkerLayout | None) -> Region:
    usual = default_region(rig, layout)
    return Region(
        usual.radius_mm if options.radius_mm is None else options.radius_mm,
        usual.lowest_mm if options.above_mm is None else options.above_mm,
        usual.highest_mm if options.below_mm is None else options.below_mm,
    )


def _check_fits(recording: Recording, rig: Rig) -> None:
    if recording.camera_size != rig.camera.size:
        raise wrong_size(recording.camera_size, rig)
    for entry in recording.select(Role.SCAN, Role.BACKGROUND):
        for laser in entry.lasers_on:
            if laser not in rig.lasers:
                raise unknown_laser(laser, rig)


def _nominal(recording: Recording, stops: list[Stop[FrameEntry]]) -> NominalAngles:
    lit = [pair.lit for stop in stops for view in stop.views for pair in view.exposures]
    return "commanded angle" if any(entry.angle_deg is not None for entry in lit) else "constant speed"


def _background(recording: Recording, observer: Observer) -> Background:
    """Stripes of the background frames; their laser-off partner is the dark one taken at the same angle."""
    entries = recording.select(Role.BACKGROUND)
    dark_of = {entry.angle_deg: entry for entry in entries if not entry.lasers_on}
    seen: list[tuple[str, LaserStripe]] = []
    for entry in entries:
        if entry.lasers_on:
            partner = dark_of.get(entry.angle_deg)
            dark = None if partner is None else recording.load(partner)
            seen += observer.stripes(LitView(entry.lasers_on, (LitPair(recording.load(entry), dark),)))
    return Background.of(seen, observer.orientations, max(recording.camera_size))


def _marker_views(
    recording: Recording, stops: list[Stop[FrameEntry]], platter: PlatterSpec, workers: int
) -> tuple[list[SeenMarkers], list[float]]:
    """What an even choice of stops shows of the markers, and their nominal angles."""
    chosen = [stops[k] for k in np.unique(np.linspace(0, len(stops) - 1, _LAYOUT_VIEWS).astype(int))]

    def look(stop: Stop[FrameEntry]) -> SeenMarkers:
        return seen_markers(recording.load(stop.frames[0], grey=True), platter)

    return list(ordered_map(look, chosen, workers)), [stop.turn_rad for stop in chosen]


def _solved_layout(
    rig: Rig, views: list[SeenMarkers], turns: list[float]
) -> tuple[MarkerLayout, list[TableCheck], list[str]]:
    try:
        fit = solve_layout(rig.camera, rig.axis, views, np.array(turns))
    except ValueError:
        warning = (
            "The markers on the table were seen at fewer than three angles; the nominal angles are used."
        )
        return {}, [], [warning]
    if fit.rms_px > _LAYOUT_WORST_PX:
        warning = (
            f"The markers do not turn about the calibrated axis (they miss it by {fit.rms_px:.1f} px): the "
            "camera or the table was moved since; calibrate again. The nominal angles are used."
        )
        return {}, [], [warning]
    tables = []
    if np.isfinite(rig.axis.offset_mm):
        tables = [check_by_markers(np.concatenate(list(fit.layout.values())))]
    return fit.layout, tables, []


def _first_offset(rig: Rig, layout: MarkerLayout, views: list[SeenMarkers], turns: list[float]) -> float:
    """How far the first stop that shows markers is from its nominal angle, radians."""
    for view, turn in zip(views, turns, strict=True):
        angle, _ = angle_from_markers(rig.camera, rig.axis, layout, view)
        if np.isfinite(angle):
            return float(np.angle(np.exp(1j * (angle - turn))))
    return 0.0
