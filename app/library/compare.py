"""Two scans side by side: what was set, what came of it, and how far their clouds lie apart."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.calibration.compare import Comparison
from app.calibration.compare import compare as compare_calibrations
from app.calibration.record import CalibrationRecord
from app.documents import read_document
from app.errors import CalibrationFileError, PointCloudFileError, RecordingError
from app.library.deviation import Deviation, deviation
from app.library.item import CALIBRATION_FILE, SCAN_FILE, ScanItem
from app.library.library import Library
from app.scanning.session import ScanFile


@dataclass(frozen=True, slots=True)
class Difference:
    """A setting that is not the same; None where a scan does not have it.

    Attributes:
        setting: its place in `scan.json`, such as `plan.steps`.
    """

    setting: str
    first: Any
    second: Any


@dataclass(frozen=True, slots=True)
class ScanComparison:
    """Two scans.

    Attributes:
        first, second: what they are.
        settings: that differ.
        calibration: what the second's calibration has changed; None where `calibration_note` says why.
        calibration_note: a sentence; empty where they could be compared.
        deviation: of the newest clouds; None where `deviation_note` says why.
        deviation_note: a sentence; empty where it could be measured.
    """

    first: ScanItem
    second: ScanItem
    settings: tuple[Difference, ...]
    calibration: Comparison | None
    calibration_note: str
    deviation: Deviation | None
    deviation_note: str


def compare_scans(library: Library, first: str, second: str) -> ScanComparison:
    """Compare two scans of a library; memory and time are bounded, however large their clouds are.

    Raises:
        ScanNotFound: one of them is not there.
    """
    one, other = library.scan(first), library.scan(second)
    found = ScanComparison(one, other, _settings(one.folder, other.folder), None, "", None, "")
    try:
        records = [CalibrationRecord.load(item.folder / CALIBRATION_FILE) for item in (one, other)]
        found = replace(found, calibration=compare_calibrations(*records))
    except CalibrationFileError as error:
        found = replace(found, calibration_note=_without_folders(error.message, one, other))
    note = _why_apart(one) or _why_apart(other)
    if note:
        return replace(found, deviation_note=note)
    try:
        paths = [item.folder / item.clouds[-1].name for item in (one, other)]
        return replace(found, deviation=deviation(*paths))
    except PointCloudFileError as error:
        return replace(found, deviation_note=_without_folders(error.message, one, other))


def _why_apart(item: ScanItem) -> str:
    """Why nobody knows where its newest cloud lies on the table; empty where that is known."""
    if not item.clouds:
        return f"The scan {item.title!r} has no cloud."
    if not item.pictures or not (item.calibration or item.clouds[-1].calibrated):
        return f"Nobody knows where on the table the cloud of {item.title!r} was: it was made elsewhere."
    return ""


def _settings(first: Path, second: Path) -> tuple[Difference, ...]:
    one, other = (dict(_flat("", _plan(folder))) for folder in (first, second))
    names = [*one, *(name for name in other if name not in one)]
    return tuple(
        Difference(name, one.get(name), other.get(name))
        for name in names
        if one.get(name) != other.get(name)
    )  # fmt: skip


def _plan(folder: Path) -> dict[str, Any]:
    """What of `scan.json` was chosen, defaults filled in; nothing where there is none that can be read."""
    if not (folder / SCAN_FILE).is_file():
        return {}
    try:
        file = read_document(folder / SCAN_FILE, ScanFile, RecordingError)
    except RecordingError:
        return {}
    chosen: dict[str, Any] = json.loads(file.model_dump_json(include={"bench", "plan"}))
    return chosen


def _flat(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{place}.{key}" if place else key, inner)
    else:
        yield place, value


def _without_folders(sentence: str, *items: ScanItem) -> str:
    for item in items:
        sentence = sentence.replace(str(item.folder), item.name)
    return sentence
