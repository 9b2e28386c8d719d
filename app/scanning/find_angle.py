"""Where the table stands, found by looking at the markers on it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.devices.bench import Bench
from app.devices.frame import Use
from app.geometry.platter import MarkerLayout, SeenMarkers, angle_from_markers
from app.geometry.rig import Rig
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.scanning.observe import seen_markers
from app.vision.markers import PlatterSpec

_WORST_FIT_PX = 3.0
_PICTURE_S = 3.0
# How far outside the believed range a table is still believed to stand, degrees.
_SLACK_DEG = 5.0
_REFERENCES = 5


@dataclass(frozen=True, eq=False, slots=True)
class MarkerFinder:
    """Compares the markers as they are now with a picture of the scan whose angle is known.

    Attributes:
        rig: the calibrated scanner; its table's height must be known.
        platter: the markers.
        folder: of the recording as it grows.
    """

    rig: Rig
    platter: PlatterSpec
    folder: Path

    def __call__(self, bench: Bench, low_deg: float, high_deg: float) -> float | None:
        """The angle, within the range or a little beside it; None where no marker tells."""
        recording = Recording.open(self.folder)
        known = self._reference(recording)
        if known is None:
            return None
        angle_deg, layout = known
        bench.camera.prepare(Use.LASER)
        frame = bench.camera.fresh_frame(timeout_s=_PICTURE_S)
        seen = seen_markers(Shot(frame.image(grey=True), Role.TEXTURE), self.platter)
        turned, rms_px = angle_from_markers(self.rig.camera, self.rig.axis, layout, seen)
        if not np.isfinite(turned) or rms_px > _WORST_FIT_PX:
            return None
        way = 1.0 if recording.turn_rad(1.0) > 0.0 else -1.0
        found_deg = angle_deg + way * float(np.degrees(turned))
        middle_deg = 0.5 * (low_deg + high_deg)
        found_deg += 360.0 * round((middle_deg - found_deg) / 360.0)
        is_likely = low_deg - _SLACK_DEG <= found_deg <= high_deg + _SLACK_DEG
        return found_deg if is_likely else None

    def _reference(self, recording: Recording) -> tuple[float, MarkerLayout] | None:
        """A picture's angle, and where its markers lie on the table as it stood then."""
        told = [entry for entry in recording.entries if entry.angle_deg is not None]
        newest = list(reversed(told[-_REFERENCES:]))
        # Dark pictures show the markers without a stripe across them.
        for entry in sorted(newest, key=lambda entry: bool(entry.lasers_on)):
            seen = seen_markers(recording.load(entry, grey=True), self.platter)
            if seen and entry.angle_deg is not None:
                return entry.angle_deg, layout_on_table(self.rig, seen)
        return None


def layout_on_table(rig: Rig, seen: SeenMarkers) -> MarkerLayout:
    """Corners (4, 3) mm in the table frame, where the rays of their pixels meet the table's plane.

    Args:
        rig: with a table whose height is known.
        seen: corners in a picture at table angle 0.
    """
    table_from_camera = rig.axis.table_from_camera(0.0)
    eye = table_from_camera.translation
    layout = {}
    for number, pixels in seen.items():
        rays = rig.camera.rays(pixels) @ table_from_camera.rotation.T
        layout[number] = eye - (eye[2] / rays[:, 2])[:, None] * rays
    return layout
