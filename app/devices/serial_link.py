"""A serial port as drivers want it: bytes out, lines back, and every failure an error that names the port."""

import contextlib
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import serial

from app.devices.port_lock import held_alone, is_shared
from app.devices.ports import SerialPort, join_group, lasting_name, resolve_port, serial_ports
from app.errors import DeviceDenied, DeviceError, DeviceLost, DeviceNotFound, DeviceTimeout, MoveStopped

_POLL_S = 0.1
_WRITE_TIMEOUT_S = 2.0
_MOST_KEPT = 65536
# Longer than any board's farewell, see `Farewell`.
_FAREWELL_S = 10.0

try:
    from termios import error as _TerminalError  # noqa: N812 (a class of the standard library)
except ImportError:
    _TerminalError = OSError  # type: ignore[assignment, misc]
# What pyserial lets through when a port goes away under it.
GONE = (serial.SerialException, OSError, _TerminalError)


class SerialLink:
    """One open port. A thread reads all the time, so that a port that goes away is noticed at once.

    A dialogue (write, then wait for the answer) is held by one thread at a time with `dialogue()`.
    `interrupt` makes the waiting thread give up with `MoveStopped`, so that a stop overtakes a move.

    Attributes:
        port: path or URL, as `serial.serial_for_url` takes it.
        device: what messages call it.
        transcript: told every byte that goes out (`>`) or comes in (`<`), for a console or a log.
        overtaker: held by whoever stops the board, so that no second one interrupts the stop.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        device: str,
        *,
        stop_bits: float = 1,
        on_lost: Callable[[], None] | None = None,
        ports: Callable[[], Sequence[SerialPort]] = serial_ports,
    ) -> None:
        self.port, self.baud, self.device = port, baud, device
        self._stop_bits, self._on_lost = stop_bits, on_lost
        self._serial: serial.Serial | None = None
        self._held = contextlib.ExitStack()
        self._buffer = bytearray()
        self._arrived = threading.Condition()
        self._dialogue, self.overtaker = threading.RLock(), threading.RLock()
        self._lost: str | None = None
        self._ports, self._lasting = ports, ""
        self._interrupts = 0
        self._since: int | None = None
        self._reader: threading.Thread | None = None
        self.transcript: Callable[[str, bytes], None] | None = None

    def open(self) -> None:
        """Open the port; an Arduino-type board resets by that.

        Raises:
            DeviceNotFound, DeviceDenied, DeviceError: with what to do.
        """
        path = self._path()
        ends = time.monotonic() + _FAREWELL_S
        while self._serial is None:
            try:
                with contextlib.ExitStack() as stack:
                    # Exclusive, so that a second program is told; network bridges do not know the option.
                    stack.enter_context(held_alone(path))
                    self._serial = serial.serial_for_url(
                        path, self.baud, timeout=_POLL_S, write_timeout=_WRITE_TIMEOUT_S,
                        stopbits=self._stop_bits, **({} if "://" in self.port else {"exclusive": True}),  # type: ignore[arg-type]
                    )  # fmt: skip
                    self._held = stack.pop_all()
            except (*GONE, ValueError) as error:
                problem = open_error(self.port, self.device, error)
                is_held = isinstance(problem, DeviceDenied)
                # The watchdog of a program that is gone may have it.
                if not is_held or time.monotonic() > ends or not is_shared(path):
                    raise problem from error
                time.sleep(_POLL_S)
        self._lasting = "" if "://" in path else lasting_name(path, self._ports)
        self._lost = None
        self._buffer.clear()
        self._reader = threading.Thread(target=self._read, name=f"serial {self.port}", daemon=True)
        self._reader.start()

    def _path(self) -> str:
        """The port as it is called now: an adapter that comes back as another node is found again."""
        path = resolve_port(self.port, self._ports)
        if "://" not in path and not Path(path).exists() and self._lasting:
            return resolve_port(self._lasting, self._ports)
        return path

    def close(self) -> None:
        """Let go of the port; never fails."""
        port, self._serial = self._serial, None
        if port is not None:
            with contextlib.suppress(*GONE, AttributeError):
                # Bridges in the network do not know it; their reads are short.
                port.cancel_read()
            with contextlib.suppress(*GONE):
                port.close()
        self._held.close()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=2.0)
        self._reader = None

    @property
    def is_open(self) -> bool:
        return self._serial is not None and self._lost is None

    @contextmanager
    def dialogue(self, *, wait_s: float = 60.0) -> Iterator[None]:
        """Nobody else talks to the board meanwhile; a thread may enter it again."""
        if not self._dialogue.acquire(timeout=wait_s):
            raise DeviceError(self.device, "is busy with another command", "Stop that command first.")
        outer = self._since
        if outer is None:
            self._since = self._interrupts
        try:
            yield
        finally:
            self._since = outer
            self._dialogue.release()

    def interrupt(self) -> None:
        """Whoever holds a dialogue now gives up waiting with `MoveStopped`; later ones are not affected."""
        with self._arrived:
            self._interrupts += 1
            self._arrived.notify_all()

    def write(self, data: bytes) -> None:
        """Put bytes on the wire, from any thread, in a dialogue or not.

        Raises:
            DeviceLost: the port is gone.
        """
        port = self._serial
        if port is None or self._lost is not None:
            raise self._gone()
        try:
            port.write(data)
        except GONE as error:
            self._mark_lost(str(error))
            raise self._gone() from error
        if self.transcript is not None:
            self.transcript(">", data)

    def discard(self) -> bytes:
        """Throw away what has arrived and nobody waited for, such as late answers; returns it."""
        with self._arrived:
            stale = bytes(self._buffer)
            self._buffer.clear()
            return stale

    def wait_for(self, pattern: re.Pattern[bytes], timeout_s: float, command: str) -> re.Match[bytes]:
        """Wait until what has arrived matches, anywhere; takes everything up to the match's end.

        Args:
            pattern: searched in the bytes since the last match; anchor it with the line end.
            timeout_s: from now.
            command: what is waited for, for the message.

        Raises:
            DeviceTimeout, DeviceLost, MoveStopped.
        """
        until = time.monotonic() + timeout_s
        with self._arrived:
            began = self._interrupts if self._since is None else self._since
            while True:
                match = pattern.search(bytes(self._buffer))
                if match:
                    del self._buffer[: match.end()]
                    return match
                if self._interrupts != began:
                    raise MoveStopped(self.device, f"{command!r} was stopped")
                if self._lost is not None or self._serial is None:
                    raise self._gone()
                left = until - time.monotonic()
                if left <= 0.0:
                    raise DeviceTimeout(self.device, command, timeout_s)
                self._arrived.wait(left)

    def read_line(self, timeout_s: float, command: str) -> str:
        """The next line without its end, undecodable bytes replaced. Raises as `wait_for`."""
        return self.wait_for(_LINE, timeout_s, command)[1].decode("ascii", "replace")

    def listen(self, duration_s: float, until: re.Pattern[bytes] | None = None) -> bytes:
        """Everything that arrives within a time, or until a pattern has come; it is taken."""
        ends = time.monotonic() + duration_s
        with self._arrived:
            while (left := ends - time.monotonic()) > 0.0 and self._lost is None:
                if until is not None and until.search(bytes(self._buffer)):
                    break
                self._arrived.wait(left)
            return self.discard()

    def _read(self) -> None:
        port = self._serial
        while port is not None and port is self._serial:
            try:
                data = port.read(max(1, port.in_waiting))
            except (*GONE, AttributeError, TypeError, ValueError) as error:
                # pyserial fails with the latter three when the port is closed while it reads.
                if port is self._serial:
                    self._mark_lost(str(error))
                return
            if not data:
                continue
            with self._arrived:
                self._buffer += data
                del self._buffer[:-_MOST_KEPT]
                self._arrived.notify_all()
            if self.transcript is not None:
                self.transcript("<", data)

    def _mark_lost(self, why: str) -> None:
        with self._arrived:
            is_news = self._lost is None
            self._lost = why
            self._arrived.notify_all()
        if is_news and self._on_lost is not None:
            self._on_lost()

    def _gone(self) -> DeviceLost:
        return DeviceLost(self.device, "the port is gone" if self._lost else "is not connected")


# A carriage return ends a line once it is known that no line feed follows it.
_LINE = re.compile(rb"([^\r\n]*)(?:\r?\n|\r(?=[^\n]))")


def open_error(port: str, device: str, error: BaseException) -> DeviceError:
    """Why a port could not be opened, and what to do."""
    number = getattr(error, "errno", None)
    text = str(error)
    if number == 2 or "FileNotFoundError" in text or "could not find" in text.lower():
        return DeviceNotFound(device, f"there is no port {port}")
    if number == 13 or "PermissionError" in text or "Access is denied" in text:
        return DeviceDenied(device, f"this user may not open {port}", join_group(port))
    if number in (11, 16) or "Could not exclusively lock" in text or "busy" in text.lower():
        return DeviceDenied(device, f"another program uses {port}")
    if isinstance(error, ValueError) or "ioctl" in text or "not a tty" in text.lower() or number in (25, 22):
        return DeviceError(
            device, f"{port} is not a serial port", "Name a port that `turnscan devices` lists."
        )
    return DeviceError(device, f"{port} cannot be opened ({text})")
