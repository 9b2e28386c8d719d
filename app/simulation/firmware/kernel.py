"""The clockwork under every simulated board: a serial port with its timing, and a program that sleeps.

Time is given, never read, so that a program runs the same in a test, where hours pass at once, and behind a
pseudo-terminal, where they do not.
"""

import math
from collections import deque
from collections.abc import Generator, Iterator, Mapping
from types import MappingProxyType

from app.registry import Registry
from app.simulation.firmware.plant import Plant

_BITS_PER_BYTE = 10


class Firmware:
    """A board: power, reset line, serial port, and the program that runs on it.

    A dialect is a subclass with a `program`: a generator that does what the board's main loop does and yields
    the time until which it has nothing to do (`math.inf` for until something arrives). It is resumed at that
    time, or as soon as a byte has arrived. What an interrupt does, it does in `on_byte`.

    Attributes:
        plant: what the board drives.
        now_s: time of the simulated world.
        baud: bits per second.
        received: bytes that the program has not read yet.
        buffer_size: bytes the board can keep; further ones are lost.
        boot_s: how long the boot loader eats what is sent after a reset.
        deaf_until_s: while interrupts are off, what arrives is lost.
        lost_bytes: how many were.
        steps_per_turn: pulses that turn the standard table once.
        outputs: the plant's laser outputs, in the order in which a rig's lasers are plugged in.
        channels: what the board's driver calls these.
        driver: which driver speaks to it, where it has another name than the dialect.
        driver_options: with which that driver fits the standard table.
    """

    baud = 115200
    buffer_size = 128
    boot_s = 1.0
    steps_per_turn = 3200.0
    outputs: tuple[int, ...] = (0, 1)
    channels: tuple[int, ...] = (1, 2)
    driver = ""
    driver_options: Mapping[str, object] = MappingProxyType({})

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.now_s = 0.0
        self.received: deque[int] = deque()
        self.deaf_until_s = -math.inf
        self.lost_bytes = 0
        self._arriving: deque[tuple[float, int]] = deque()
        self._sent: deque[tuple[float, int]] = deque()
        self._line_free_s = 0.0
        self._boots_until_s = math.inf
        self._wake_s = math.inf
        self._running: Iterator[float] | None = None

    def program(self) -> Iterator[float]:
        """The main loop, from the first instruction after the boot loader."""
        raise NotImplementedError

    def on_byte(self, byte: int) -> bool:
        """Interrupt: a byte has arrived. True when it is dealt with and the program shall not see it."""
        return False

    def on_reset(self) -> None:
        """Pins float: whatever the plant does without its board. Settings that survive stay."""
        raise NotImplementedError

    def reset(self, time_s: float) -> None:
        """The reset line: everything starts anew with the boot loader; what is not sent yet never will be."""
        self.advance(time_s)
        self._sent = deque(pair for pair in self._sent if pair[0] <= self.now_s)
        self._line_free_s = self.now_s
        self._restart(self.boot_s)

    def restart_program(self) -> None:
        """What the board does to itself: its program anew, without the boot loader. Called by the program or
        an interrupt; the program under way is not resumed."""
        self._restart(0.0)

    def receive(self, data: bytes, time_s: float) -> None:
        """Bytes that the host put on the wire from `time_s` on, one after the other."""
        at = max(time_s, self._arriving[-1][0] if self._arriving else -math.inf)
        for byte in data:
            at += self.byte_s
            self._arriving.append((at, byte))

    def advance(self, time_s: float) -> None:
        """Do everything that is due until a time."""
        while True:
            due = self.due_s
            if due > time_s:
                break
            self.now_s = max(self.now_s, due)
            if self._arriving and self._arriving[0][0] <= due:
                self._take(self._arriving.popleft()[1])
            else:
                self._run()
        self.now_s = max(self.now_s, time_s)

    def sent(self, until_s: float = math.inf) -> bytes:
        """Take what the board has put on the wire up to a time."""
        return bytes(byte for _, byte in self.sent_with_times(until_s))

    def sent_with_times(self, until_s: float = math.inf) -> list[tuple[float, int]]:
        """As `sent`, each byte with the time at which its last bit was on the wire."""
        taken = []
        while self._sent and self._sent[0][0] <= until_s:
            taken.append(self._sent.popleft())
        return taken

    @property
    def due_s(self) -> float:
        """When something happens next; `math.inf` when nothing does until a byte arrives."""
        program = self._boots_until_s if self._running is None else self._wake_s
        return min(program, self._arriving[0][0] if self._arriving else math.inf)

    @property
    def next_sent_s(self) -> float:
        """When the next byte will have been sent; `math.inf` for none."""
        return self._sent[0][0] if self._sent else math.inf

    @property
    def byte_s(self) -> float:
        """How long a byte takes on the wire."""
        return _BITS_PER_BYTE / self.baud

    def say(self, text: str | bytes) -> None:
        """Put something on the wire, behind what is still going out."""
        data = text.encode("latin-1") if isinstance(text, str) else text
        at = max(self.now_s, self._line_free_s)
        for byte in data:
            at += self.byte_s
            self._sent.append((at, byte))
        self._line_free_s = at

    def read_byte(self) -> Generator[float, None, int]:
        """`byte = yield from self.read_byte()`: wait for one."""
        while not self.received:
            yield math.inf
        return self.received.popleft()

    def sleep(self, duration_s: float) -> Generator[float, None, None]:
        """`yield from self.sleep(0.5)`: nothing for so long; interrupts go on."""
        until = self.now_s + duration_s
        while self.now_s < until:
            yield until

    def _restart(self, boot_s: float) -> None:
        self.received.clear()
        self.deaf_until_s = -math.inf
        self._running = None
        self._boots_until_s = self.now_s + boot_s
        self.on_reset()

    def _take(self, byte: int) -> None:
        is_booting = self._running is None and self.now_s < self._boots_until_s
        if is_booting or self.now_s < self.deaf_until_s:
            self.lost_bytes += 1
        elif self.on_byte(byte) or self._keep(byte):
            self._wake_s = min(self._wake_s, self.now_s)
        else:
            self.lost_bytes += 1

    def _keep(self, byte: int) -> bool:
        if len(self.received) >= self.buffer_size - 1:
            return False
        self.received.append(byte)
        return True

    def _run(self) -> None:
        if self._running is None:
            self._running, self._boots_until_s = self.program(), math.inf
        running = self._running
        wake = next(running, math.inf)
        # A program that restarted itself has been replaced, and its last wish with it.
        if self._running is running:
            self._wake_s = wake


FIRMWARES: Registry[Firmware] = Registry("simulated board", "app.simulation.firmware.dialects")
