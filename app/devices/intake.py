"""What a driver grabs becomes frames: counted, timed, and without those that are damaged or came before."""

from dataclasses import replace

from app.devices.camera_driver import CameraFacts, RawFrame
from app.devices.frame import Frame, LazyPicture, Mounting
from app.devices.rhythm import Repeats, Rhythm
from app.recording.picture import inspect

# A time stamp further back than this is of another clock.
_OLDEST_S = 10.0
_FPS_UNKNOWN = 30.0
_SILENT = "is frozen: it sends no pictures"


class Intake:
    """Takes the pictures of one camera, one thread at a time.

    Args:
        name: what messages call the camera.
        facts: of the camera, as it hangs.
        mounting: what makes its pictures upright.
        latency_s: from the beginning of an exposure to the arrival of its picture.

    Attributes:
        frames, damaged, repeated: how many came that are good, broken, and the one before once more.
        flaw: what is wrong with the camera if no further frame comes, as a predicate.
        has_begun: whether a frame has come since the camera was opened.
    """

    def __init__(self, name: str, facts: CameraFacts, mounting: Mounting, latency_s: float) -> None:
        self.name, self.latency_s = name, latency_s
        self.frames = self.damaged = self.repeated = 0
        self.flaw, self.has_begun = _SILENT, False
        self._facts, self._mounting = facts, mounting
        self._rhythm, self._repeats = Rhythm(), Repeats()

    @property
    def facts(self) -> CameraFacts:
        """Of the camera, with the size of upright pictures."""
        return replace(self._facts, size=self._mounting.size(self._facts.size))

    @property
    def fps(self) -> float:
        """Pictures per second lately; 0 before there are enough."""
        return self._rhythm.fps

    @property
    def lost(self) -> int:
        """Pictures that came damaged or, by the times of the others, not at all."""
        return self.damaged + self._rhythm.missing

    @property
    def is_paced(self) -> bool:
        """Whether it is known when the next picture is due."""
        return self.has_begun and (self._rhythm.fps or self._facts.fps) > 0.0

    @property
    def period_s(self) -> float:
        """From one picture to the next, as measured or as the camera says."""
        return 1.0 / (self._rhythm.fps or self._facts.fps or _FPS_UNKNOWN)

    def take(self, raw: RawFrame, arrived_s: float) -> Frame | None:
        """The frame; None for a picture that is damaged or came before."""
        if isinstance(raw.data, bytes) and not _is_whole(raw.data, self._facts.size):
            self.damaged += 1
            self.flaw = "sends nothing but damaged pictures"
            return None
        if self._repeats.is_repeat(raw.data):
            self.repeated += 1
            self.flaw = "is frozen: it sends the same picture again and again"
            return None
        exposed_s, is_timed = arrived_s - self.latency_s, False
        if raw.exposed_s is not None and arrived_s - _OLDEST_S < raw.exposed_s <= arrived_s:
            exposed_s, is_timed = raw.exposed_s, True
        where = f"{self.name} frame {self.frames}"
        frame = Frame(
            self.frames, self._mounting.size(self._facts.size), exposed_s, arrived_s, raw.exposure_us,
            is_timed, LazyPicture(raw, self._facts.size, self._mounting, where),
        )  # fmt: skip
        self.frames += 1
        self.flaw, self.has_begun = _SILENT, True
        self._rhythm.add(exposed_s, is_timed)
        return frame

    def reopen(self, facts: CameraFacts) -> None:
        """The camera was away and is back.

        Raises:
            ValueError: with pictures of another size; the problem as a predicate.
        """
        if facts.size != self._facts.size:
            raise ValueError(
                "came back with {} x {} pixels instead of {} x {}".format(*facts.size, *self._facts.size)
            )
        self._facts = facts
        self.flaw, self.has_begun = _SILENT, False
        self._rhythm.pause()
        self._repeats = Repeats()

    def surely_began_s(self, frame: Frame) -> float:
        """No later than this its exposure began, whatever the camera leaves untold.

        An untold time is that of the arrival, and a picture may have waited a period for its turn.
        """
        return frame.exposed_s if frame.is_timed else frame.exposed_s - self.period_s


def _is_whole(data: bytes, size: tuple[int, int]) -> bool:
    try:
        return inspect(data).size == size
    except ValueError:
        return False
