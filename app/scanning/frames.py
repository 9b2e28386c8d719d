"""Stops of a recording on disk: which frames they need, and decoding them when their turn comes."""

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import replace
from pathlib import PurePosixPath
from threading import Lock

import cv2
import numpy as np

from app.recording.manifest import FrameEntry
from app.recording.reader import Recording
from app.recording.shot import Role, Shot
from app.scanning.stops import LitPair, LitView, Stop, Texture, group_stops, missing_angle
from app.vision.stripe import Image

TEXTURE_LOOK = "texture"
"""What a picture of a round that was taken for colour alone is called in the recording."""

_TEXTURES_KEPT = 3


class StopLoader:
    """Turns the entries of a stop into pictures; may be called by several threads.

    A lit JPEG with a dark partner is decoded as grey: that is the plane the camera stored in full
    resolution, and it takes half the time. Everything else is decoded in colour.

    Args:
        recording: where the frames lie.
        with_colour: whether colour pictures are wanted.
    """

    def __init__(self, recording: Recording, *, with_colour: bool = True) -> None:
        self.recording, self.with_colour = recording, with_colour
        self._textures: OrderedDict[str, Shot] = OrderedDict()
        self._lock = Lock()

    def stops(self) -> list[Stop[FrameEntry]]:
        """What there is to do; nothing is decoded yet.

        Raises:
            ReconstructionError: a frame has no angle.
        """
        entries = self.recording.select(Role.SCAN, Role.TEXTURE)
        dark = [entry for entry in entries if not entry.lasers_on]
        stops = group_stops(entries, self._turn_of, dark)
        exposed = exposed_for_colour(entries)
        if not exposed:
            return stops
        # The dark partner of a lit picture has the laser's exposure, which shows little colour.
        turns = np.array([self._turn_of(entry) for entry in exposed])
        nearest = [int(np.argmax(np.cos(turns - stop.turn_rad))) for stop in stops]
        return [
            replace(stop, texture=Texture(exposed[number], float(turns[number]), is_here=False))
            for stop, number in zip(stops, nearest, strict=True)
        ]

    def load(self, stop: Stop[FrameEntry]) -> Stop[Shot]:
        """Decode a stop.

        Raises:
            FrameError: naming the frame.
        """
        loaded: dict[tuple[str, bool], Shot] = {}

        def shot(entry: FrameEntry, *, grey: bool) -> Shot:
            if grey and (entry.file, False) in loaded:
                return _as_grey(loaded[entry.file, False])
            if (entry.file, grey) not in loaded:
                loaded[entry.file, grey] = self.recording.load(entry, grey=grey)
            return loaded[entry.file, grey]

        texture: Texture[Shot] | None = None
        if stop.texture is not None and self.with_colour:
            wanted = stop.texture
            picture = shot(wanted.frame, grey=False) if wanted.is_here else self._far_texture(wanted.frame)
            texture = Texture(picture, wanted.turn_rad, wanted.is_here)
        views = []
        for view in stop.views:
            pairs = []
            for pair in view.exposures:
                grey = pair.dark is not None and _is_jpeg(pair.lit.file)
                dark = None if pair.dark is None else shot(pair.dark, grey=grey)
                pairs.append(LitPair(shot(pair.lit, grey=grey), dark))
            views.append(LitView(view.lasers, tuple(pairs)))
        darks = {
            pair.dark.name: pair.dark for view in views for pair in view.exposures if pair.dark is not None
        }
        if texture is not None and texture.is_here:
            darks.setdefault(texture.frame.name, texture.frame)
        return Stop(stop.number, stop.turn_rad, tuple(views), tuple(darks.values()), texture)

    def _turn_of(self, entry: FrameEntry) -> float:
        angle_deg = self.recording.angle_deg(entry)
        if angle_deg is None or not np.isfinite(angle_deg):
            raise missing_angle(entry.file)
        return self.recording.turn_rad(angle_deg)

    def _far_texture(self, entry: FrameEntry) -> Shot:
        with self._lock:
            if entry.file not in self._textures:
                self._textures[entry.file] = self.recording.load(entry)
                while len(self._textures) > _TEXTURES_KEPT:
                    self._textures.popitem(last=False)
            self._textures.move_to_end(entry.file)
            return self._textures[entry.file]


def exposed_for_colour(entries: Iterable[FrameEntry]) -> tuple[FrameEntry, ...]:
    """Pictures that were taken for their colour: the newest round of them, else those of the scan itself."""
    rounds = [entry for entry in entries if entry.unknown.get("look") == TEXTURE_LOOK]
    if rounds:
        newest = rounds[-1].unknown.get("round")
        return tuple(entry for entry in rounds if entry.unknown.get("round") == newest)
    return tuple(entry for entry in entries if entry.unknown.get("look") == "colour")


def _is_jpeg(file: str) -> bool:
    return PurePosixPath(file).suffix.lower() in (".jpg", ".jpeg")


def _as_grey(shot: Shot) -> Shot:
    if shot.image.ndim == 2:
        return shot
    image: Image = cv2.cvtColor(shot.image, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    return Shot(
        image, shot.role, shot.lasers_on, shot.angle_deg, shot.pose, shot.time_s, shot.exposure_us, shot.name
    )
