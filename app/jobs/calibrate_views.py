"""The views of a calibration as they lie on disk."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from app.calibration.capture_session import CaptureSession
from app.errors import NotThere
from app.geometry.arrays import Pixels
from app.jobs.calibrate_state import Step
from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role

_STEPS = {Role.INTRINSICS: Step.CAMERA, Role.LASER_PLANE: Step.LASERS, Role.AXIS: Step.BOARD}
_THUMBNAIL_PX = 320


@dataclass(frozen=True, eq=False, slots=True)
class TakenView:
    """One view.

    Attributes:
        number: of its first entry in the recording.
        file: of that entry.
        step: that it was taken in.
        pose: number of the board's place, where it has one.
        angle_deg: of the table, where it stood on it.
        corners: (N, 2) px.
        outline: (4, 2) px, or (0, 2).
    """

    number: int
    file: str
    step: Step
    pose: int | None
    angle_deg: float | None
    corners: Pixels
    outline: Pixels


def views_on_disk(folder: Path) -> tuple[TakenView, ...]:
    """Those that a person may judge, in their order; none where nothing was taken yet.

    Raises:
        RecordingError: the recording cannot be read.
    """
    if not CaptureSession.is_begun(folder):
        return ()
    return tuple(
        _view(number, entry)
        for number, entry in enumerate(Recording.open(folder).entries)
        if entry.role in _STEPS and not entry.lasers_on
    )


def thumbnail(folder: Path, number: int) -> bytes:
    """A small JPEG of a view.

    Raises:
        NotThere: there is no such view.
        FrameError: its picture cannot be read.
    """
    if CaptureSession.is_begun(folder):
        recording = Recording.open(folder)
        if 0 <= number < len(recording.entries):
            image = recording.load(recording.entries[number]).image
            height, width = image.shape[:2]
            share = min(1.0, _THUMBNAIL_PX / width)
            size = (max(1, round(share * width)), max(1, round(share * height)))
            small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            return bytes(cv2.imencode(".jpg", small)[1])
    raise NotThere(f"There is no view {number}.")


def _view(number: int, entry: FrameEntry) -> TakenView:
    seen = entry.unknown.get("seen")
    facts = seen if isinstance(seen, dict) else {}
    return TakenView(
        number, entry.file, _STEPS[entry.role], entry.pose, entry.angle_deg,
        _pixels(facts.get("corners")), _pixels(facts.get("outline")),
    )  # fmt: skip


def _pixels(numbers: object) -> Pixels:
    """As they were kept; none where somebody else wrote something else there."""
    try:
        pixels = np.array(numbers, np.float64).reshape(-1, 2)
    except (TypeError, ValueError):
        return np.zeros((0, 2))
    return pixels if np.all(np.isfinite(pixels)) else np.zeros((0, 2))
