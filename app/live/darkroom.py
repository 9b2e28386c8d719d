"""Makes pictures of views, one thread at a time, and keeps what several of them need."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from app.devices.camera import Camera
from app.devices.frame import Frame
from app.errors import DeviceError, ScannerError
from app.live.dark import DarkReference
from app.live.develop import Flavour, develop, nothing_new
from app.live.known import Known
from app.live.meter import Meter
from app.live.picture import LivePicture
from app.live.search import Found, Search
from app.live.settings import Kind, LiveSettings
from app.live.sight import Sight

# Quick ones first; what they compute the others use.
_ORDER = (Kind.RAW, Kind.STRIPE, Kind.OVERLAY, Kind.MASK)


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What there is to be shown.

    Attributes:
        number: counts views, from 1.
        frame: the newest; None where there never was one.
        lit: lasers that were on when it came.
        problem: why none comes any more, as a sentence; empty while they do.
    """

    number: int
    frame: Frame | None
    lit: Sequence[str] = ()
    problem: str = ""


class Darkroom:
    """Pictures from views.

    Args:
        camera: that takes the frames.

    Attributes:
        dark, search, meter: see there.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.dark, self.search, self.meter = DarkReference(), Search(), Meter()
        self._sight: Sight | None = None

    def look_through(self, camera: Camera) -> None:
        """Another camera from now on."""
        self._camera, self.dark = camera, DarkReference()
        self.search.forget()

    def make(
        self,
        view: View,
        flavours: Iterable[Flavour],
        known: Known,
        settings: LiveSettings,
        hand_out: Callable[[Flavour, LivePicture], None],
    ) -> float:
        """Every flavour of a view; tell how many seconds of the processor it took.

        What the camera needs to make its file is not counted.

        Raises:
            DeviceError: the frame is no whole picture.
        """
        frame, problem, own_jpeg = view.frame, view.problem, None
        if frame is not None and not problem:
            try:
                own_jpeg = self._own_jpeg(frame)
            except DeviceError:
                raise
            except Exception as error:  # noqa: BLE001 (edge of a thread: a camera that breaks must not end it)
                frame, problem = None, _mistake(error)
        began_s = last_s = time.thread_time()
        for flavour in sorted(flavours, key=lambda each: _ORDER.index(each.kind)):
            if frame is None or problem:
                picture = nothing_new(flavour, frame, problem)
            else:
                picture = self._made(flavour, frame, view.lit, known, settings, own_jpeg)
            now_s = time.thread_time()
            self.meter.add(flavour.kind, now_s - last_s)
            last_s = now_s
            hand_out(flavour, picture)
        return time.thread_time() - began_s

    def clear(self) -> None:
        """Nobody looks any more."""
        self._sight = None
        self.search.forget()

    def _made(
        self,
        flavour: Flavour,
        frame: Frame,
        lit: Sequence[str],
        known: Known,
        settings: LiveSettings,
        own_jpeg: bytes | None,
    ) -> LivePicture:
        sight = self._sight_of(frame, lit, known, settings)
        found = Found()
        try:
            if flavour.kind in (Kind.OVERLAY, Kind.STRIPE):
                self.search.offer(sight.image, known, settings)
                found = self.search.found(settings)
            return develop(flavour, sight, found, own_jpeg)
        except DeviceError:
            raise
        except ScannerError as error:
            return nothing_new(flavour, frame, error.message)
        except Exception as error:  # noqa: BLE001 (edge of a thread: a detector that breaks must not end it)
            return nothing_new(flavour, None, _mistake(error))

    def _sight_of(self, frame: Frame, lit: Sequence[str], known: Known, settings: LiveSettings) -> Sight:
        sight = self._sight
        if (
            sight is None
            or sight.frame is not frame
            or sight.settings is not settings
            or sight.known is not known
        ):
            sight = self._sight = Sight(frame, settings, known, lit, self.dark)
        return sight

    def _own_jpeg(self, frame: Frame) -> bytes | None:
        """The camera's own file where it can be shown as it is.

        A camera that only makes its file when somebody looks, as the simulated one, does so here.
        """
        if self._camera.mounting.is_plain and self._camera.facts.gives_jpeg:
            return frame.encoded("jpeg")
        return None


def _mistake(error: Exception) -> str:
    return f"The picture could not be made ({error!r})."
