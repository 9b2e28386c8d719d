"""The bench of a server that has none: nothing is there, and it says why."""

from collections.abc import Mapping

from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, CameraEntry, TurntableEntry
from app.devices.camera import Camera
from app.devices.camera_driver import CameraFacts, Control, ControlName, RawFrame
from app.devices.turntable import Farewell, SteadyTurn, TurntableFacts
from app.errors import BenchFileError, DeviceNotFound, ScannerError


def no_bench(reason: ScannerError) -> Bench:
    """A bench without devices; connecting them fails for the reason why there is no other bench."""
    description = BenchDescription(
        name="no bench", turntable=TurntableEntry(driver="none"), camera=CameraEntry(driver="none")
    )
    return Bench(description, _NoTurntable(reason), Camera(_NoCamera()))


class _NoTurntable:
    farewell: Farewell | None = None
    is_connected = False
    angle_deg = 0.0

    def __init__(self, reason: ScannerError) -> None:
        self._reason = reason

    @property
    def facts(self) -> TurntableFacts:
        return TurntableFacts("", "", (), 0.0, can_turn_steadily=False, can_stop=False)

    def connect(self) -> None:
        raise self._missing()

    def disconnect(self) -> None:
        """Nothing is held."""

    def move_to(self, angle_deg: float) -> float:
        raise self._missing()

    def start_turning(self, angle_deg: float, speed_deg_s: float) -> SteadyTurn:
        raise self._missing()

    def finish_turning(self) -> float:
        raise self._missing()

    def position_now(self) -> float | None:
        return None

    def stop(self) -> float:
        return 0.0

    def zero(self, angle_deg: float = 0.0) -> None:
        raise self._missing()

    def set_laser(self, channel: int, is_on: bool) -> None:
        raise self._missing()

    def hold(self, is_holding: bool) -> None:
        raise self._missing()

    def make_safe(self) -> None:
        """Nothing turns, nothing is lit."""

    def talk(self, line: str) -> str:
        raise self._missing()

    def _missing(self) -> DeviceNotFound:
        reason = self._reason
        if isinstance(reason, BenchFileError):
            return DeviceNotFound(reason.where, reason.problem, reason.hint)
        return DeviceNotFound("bench", reason.message, reason.hint)


class _NoCamera:
    facts = CameraFacts("no camera", "", (640, 480), 1.0, has_timestamps=False, gives_jpeg=False)

    def connect(self) -> None:
        raise _no_camera()

    def disconnect(self) -> None:
        """Nothing is held."""

    def grab(self, timeout_s: float) -> RawFrame:
        raise _no_camera()

    def controls(self) -> Mapping[ControlName, Control]:
        return {}

    def set_control(self, name: ControlName, value: float | None) -> Control:
        raise _no_camera()


def _no_camera() -> DeviceNotFound:
    return DeviceNotFound("camera", "the server has no bench", "Start it with a bench file.")
