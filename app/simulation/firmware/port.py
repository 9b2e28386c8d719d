"""A simulated board behind a real serial port: a pseudo-terminal that any program can open."""

import contextlib
import errno
import math
import os
import random
import select
import struct
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from app.errors import OptionError
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import Firmware

_TICK_S = 0.02
_CHUNK = 4096
# TCGETS2 and struct termios2 of Linux: four flags, line, 19 control characters, speeds in and out.
_TCGETS2, _TERMIOS2 = 0x802C542A, "4IB19s2I"


class EmulatedPort:
    """Runs a `Firmware` in a thread and carries its bytes through a pseudo-terminal.

    Opening the port resets the board, as DTR does, unless `resets_on_open` is False; closing it changes
    nothing. A host at another baud rate gets and gives garbage.

    Attributes:
        firmware: the board; ask it only through `plant`, which is safe from any thread.
        link: a path that stays the same while the port comes and goes, as those under /dev/serial/by-id do.
    """

    def __init__(
        self,
        firmware: Firmware,
        link: Path,
        clock: Clock | None = None,
        *,
        resets_on_open: bool = True,
        checks_baud: bool = True,
        seed: int = 0,
    ) -> None:
        if not hasattr(os, "openpty"):
            raise OptionError(
                "A simulated board needs pseudo-terminals, which this system has not.",
                "Use Linux or macOS, or the Windows Subsystem for Linux.",
            )
        self.firmware, self.link, self.clock = firmware, link, clock or Clock()
        self._resets_on_open, self._checks_baud = resets_on_open, checks_baud
        self._random = random.Random(seed)
        self._lock = threading.RLock()
        self._master = -1
        self._is_open = False
        self._silent_until_s = self._slow_until_s = -math.inf
        self._garbage = b""
        self._wakes, self._waker = os.pipe()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"emulator {link.name}", daemon=True)
        with self._lock:
            self.firmware.reset(self.clock.now_s())
        self.plug_in()
        self._thread.start()

    @property
    def path(self) -> str:
        """The pseudo-terminal itself, such as /dev/pts/3; empty while unplugged."""
        try:
            return str(self.link.readlink())
        except OSError:
            return ""

    def plug_in(self) -> None:
        """The port appears, under a new name; its link stays the same."""
        with self._lock:
            if self._master >= 0:
                return
            import tty

            master, slave = os.openpty()
            # A terminal would echo what the board says back to it until the host has set it up.
            tty.setraw(slave)
            beside = self.link.with_name(self.link.name + ".new")
            beside.unlink(missing_ok=True)
            beside.symlink_to(os.ttyname(slave))
            beside.replace(self.link)
            os.close(slave)
            os.set_blocking(master, False)
            self._master, self._is_open = master, False
        self._wake()

    def unplug(self) -> None:
        """The port vanishes while it is open; the board loses its power, lasers and motor with it."""
        with self._lock:
            if self._master < 0:
                return
            self.firmware.reset(self.clock.now_s())
            os.close(self._master)
            self._master = -1
            self.link.unlink(missing_ok=True)
        self._wake()

    def reset(self) -> None:
        """A brown-out: the board starts anew while the port stays open."""
        with self._lock:
            self.firmware.reset(self.clock.now_s())
        self._wake()

    def silence(self, duration_s: float) -> None:
        """For so long (world seconds) nothing that the board says arrives."""
        with self._lock:
            self._silent_until_s = self.clock.now_s() + duration_s

    def slow(self, duration_s: float) -> None:
        """What the board says arrives only after so long (world seconds)."""
        with self._lock:
            self._slow_until_s = self.clock.now_s() + duration_s

    def garbage(self, count: int) -> None:
        """So many random bytes arrive from the board."""
        with self._lock:
            self._garbage += self._random.randbytes(count)
        self._wake()

    def close(self) -> None:
        """End the thread and take the port away."""
        self._is_over.set()
        self._wake()
        self._thread.join(timeout=5.0)
        with self._lock:
            if self._master >= 0:
                os.close(self._master)
                self._master = -1
            self.link.unlink(missing_ok=True)
        for handle in (self._wakes, self._waker):
            with contextlib.suppress(OSError):
                os.close(handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._waker, b"x")

    def _run(self) -> None:
        while not self._is_over.is_set():
            with self._lock:
                self._watch_open()
                master = self._master
                due = min(self.firmware.due_s, self._next_out_s())
            watched = [self._wakes] + ([master] if master >= 0 and self._is_open else [])
            wait_s = _TICK_S if math.isinf(due) else min(_TICK_S, self.clock.wait_s(due))
            try:
                ready, _, _ = select.select(watched, [], [], wait_s)
            except (OSError, ValueError):
                continue
            if self._wakes in ready:
                os.read(self._wakes, _CHUNK)
            with self._lock:
                self._take_in()
                self.firmware.advance(self.clock.now_s())
                self._give_out()

    def _watch_open(self) -> None:
        """Notice that a host opens or closes the port; without one the master hangs up."""
        if self._master < 0:
            return
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        is_open = not any(event & select.POLLHUP for _, event in poll.poll(0))
        if is_open and not self._is_open and self._resets_on_open:
            self.firmware.reset(self.clock.now_s())
        self._is_open = is_open

    def _take_in(self) -> None:
        if self._master < 0:
            return
        try:
            data = os.read(self._master, _CHUNK)
        except OSError as error:
            if error.errno not in (errno.EIO, errno.EAGAIN):
                raise
            return
        if not self._is_open and self._resets_on_open:
            # Opened, written to and closed again between two looks.
            self.firmware.reset(self.clock.now_s())
        self.firmware.receive(self._garbled(data), self.clock.now_s())

    def _next_out_s(self) -> float:
        if self._garbage:
            return -math.inf
        return max(self.firmware.next_sent_s, self._slow_until_s)

    def _give_out(self) -> None:
        now_s = self.clock.now_s()
        if now_s < self._slow_until_s:
            return
        data = self._garbled(self.firmware.sent(now_s))
        if now_s < self._silent_until_s:
            data = b""
        data, self._garbage = self._garbage + data, b""
        if not data or not self._is_open or self._master < 0:
            return
        # A host that does not read loses what its terminal cannot hold, as with a real port.
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self._master, data)

    def _garbled(self, data: bytes) -> bytes:
        """What arrives when both ends disagree about the baud rate: fewer bytes, high bits set."""
        if not data or self._master < 0 or not self._checks_baud:
            return data
        if self._host_baud() == self.firmware.baud:
            return data
        ratio = self._host_baud() / self.firmware.baud
        count = max(1, round(len(data) * min(1.0, ratio)))
        return bytes(self._random.choice((0xFF, 0xFE, 0xFC, 0xE1, 0xD6, 0xF0)) for _ in range(count))

    def _host_baud(self) -> int:
        """What the host has set its end to; a pseudo-terminal keeps it like a real port."""
        try:
            return host_baud(self._master)
        except OSError:
            return self.firmware.baud


def host_baud(handle: int) -> int:
    """The baud rate of a terminal, one that has no constant of its own included.

    Raises:
        OSError: the system cannot tell; only Linux can.
    """
    import fcntl

    raw = fcntl.ioctl(handle, _TCGETS2, bytes(struct.calcsize(_TERMIOS2)))
    return int(struct.unpack(_TERMIOS2, raw)[-1])
