"""Points while the scan goes on, from the pictures as they are taken."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Self

from app.errors import ScannerError
from app.geometry.platter import MarkerLayout
from app.geometry.rig import Rig
from app.recording.shot import Shot
from app.scanning.profile import Profile
from app.scanning.reconstruct import ReconstructionOptions
from app.scanning.scan import Taken
from app.scanning.sources import reconstruct_shots
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour, StripeDetector

_MOST_WAITING = 90


class LivePoints:
    """A thread that turns pictures into profiles. It never holds up the scan.

    Pictures that come faster than they can be computed are left out and counted; the recording has them.

    Args:
        rig, detector, colours, turn_rad, options, platter, layout, each_alone: as for `reconstruct_shots`.
        on_profile: told each profile, in the thread that computes.
        is_grey: lit pictures have dark partners and come as JPEG, which is decoded to grey as from a disk.

    Attributes:
        points: so far.
        profiles: so far.
        left_out: pictures that were.
        problem: why it ended early; empty while all is well.
    """

    def __init__(
        self,
        rig: Rig,
        detector: StripeDetector,
        colours: Mapping[str, LaserColour],
        turn_rad: Callable[[float], float],
        *,
        on_profile: Callable[[Profile], None] | None = None,
        is_grey: bool = False,
        options: ReconstructionOptions | None = None,
        platter: PlatterSpec | None = None,
        layout: MarkerLayout | None = None,
        each_alone: bool = False,
    ) -> None:
        self.points = self.profiles = self.left_out = 0
        self.problem = ""
        self._has_all = False
        self._on_profile, self._is_grey = on_profile, is_grey
        self._waiting: queue.Queue[Taken | None] = queue.Queue(_MOST_WAITING)
        options = options or ReconstructionOptions(ahead=0, with_colour=False)
        self._run = reconstruct_shots(
            self._shots(), rig, detector, colours, turn_rad, options, platter, layout, each_alone=each_alone
        )
        self._thread = threading.Thread(target=self._compute, name="live points", daemon=True)
        self._thread.start()

    def add(self, taken: Taken) -> None:
        """A picture that is on disk."""
        try:
            self._waiting.put_nowait(taken)
        except queue.Full:
            self.left_out += 1

    def close(self) -> None:
        """Compute what waits, and end."""
        self._waiting.put(None)
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _shots(self) -> Iterator[Shot]:
        while (taken := self._waiting.get()) is not None:
            yield Shot(
                taken.frame.image(grey=self._is_grey), taken.look.role, taken.look.lasers, taken.angle_deg,
                time_s=taken.time_s, exposure_us=taken.exposure_us, name=f"stop {taken.stop}",
            )  # fmt: skip
        self._has_all = True

    def _compute(self) -> None:
        try:
            for profile in self._run:
                self.points += len(profile.cloud)
                self.profiles += 1
                if self._on_profile is not None:
                    self._on_profile(profile)
        except ScannerError as error:
            self.problem = error.message
        finally:
            # Whoever closes must not wait for a thread that has ended early.
            while not self._has_all:
                self._has_all = self._waiting.get() is None
