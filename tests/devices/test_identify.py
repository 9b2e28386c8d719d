"""What is behind a port is found out by listening, and by asking what can do no harm."""

import math
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import serial
from turntable_contract import wait_until

from app.devices.identify import PING, QUESTION, RESET, Identity, identify
from app.errors import DeviceDenied, DeviceError, DeviceLost, DeviceNotFound
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.plant import Event, Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

ALL_AT_ONCE = 6


class _Mute(Firmware):
    """Something that neither speaks nor answers."""

    def on_reset(self) -> None:
        """Nothing is connected to it."""

    def program(self) -> Iterator[float]:
        while True:
            yield from self.read_byte()


class _Gps(_Mute):
    """A receiver that tells its position all the time."""

    baud = 9600

    def program(self) -> Iterator[float]:
        while True:
            self.say("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")
            yield from self.sleep(0.2)


class _Modem(_Mute):
    """A modem with echo: every line is an error to it."""

    def program(self) -> Iterator[float]:
        while True:
            byte = yield from self.read_byte()
            self.say(bytes([byte]) + (b"\r\nERROR\r\n" if byte == 0x0D else b""))


class _FastMarlin(_Mute):
    """As Marlin starts at 250000 baud."""

    baud = 250000

    def program(self) -> Iterator[float]:
        self.say("start\necho:PowerUp\nMarlin 1.1.9\n\necho: Last Updated: 2018-08-01\n")
        while True:
            yield from self.read_byte()


class _Repetier(_Mute):
    """As a firmware starts that is built like Marlin and is not."""

    def program(self) -> Iterator[float]:
        self.say("start\r\nInfo:PowerUp\r\nFree RAM:2011\r\n")
        line = b""
        while True:
            line += bytes([(yield from self.read_byte())])
            if line.endswith(b"\n"):
                self.say("FIRMWARE_NAME:Repetier_0.92 FIRMWARE_URL:x PROTOCOL_VERSION:1.0\r\nok\r\n")
                line = b""


@dataclass(frozen=True)
class Case:
    """A board, and what it must be taken for.

    Attributes:
        driver, firmware: what is expected; firmware by its beginning.
        board: name of the emulated dialect, or the class.
        options: of the dialect.
        told: lines that it was told earlier, and keeps.
        noise: when, in seconds after opening, how many random bytes come.
        resets: whether opening the port starts it anew; one that does not is awake, with a laser on.
        usb_id: of its adapter.
    """

    driver: str
    firmware: str
    board: str | type[Firmware]
    options: Mapping[str, object] = field(default_factory=dict)
    told: bytes = b""
    noise: tuple[float, int] | None = None
    resets: bool = True
    usb_id: tuple[int, int] | None = None


_OLD_FABSCAN = {"version": "v.20160101", "board": 1}
_57600_FABSCAN = {"version": "v.20170701", "board": 1}
CASES = {
    "horus": Case("horus", "Horus 0.2", "horus"),
    "horus awake": Case("horus", "Horus 0.2", "horus", resets=False),
    "horus locked": Case("horus", "Horus 0.2", "horus", told=b"$22=1\n"),
    "horus 0.1": Case("horus", "Horus 0.1", "horus_0_1"),
    "horus clone": Case("horus", "Horus 0.2, look-alike", "horus_clone"),
    "horus clone awake": Case("horus", "Horus 0.2, look-alike", "horus_clone", resets=False),
    "grbl": Case("grbl", "Grbl 1.1h", "grbl"),
    "grbl awake": Case("grbl", "Grbl 1.1h", "grbl", resets=False),
    "grbl locked": Case("grbl", "Grbl 1.1h", "grbl", told=b"$22=1\n"),
    "grblhal": Case("grbl", "GrblHAL 1.1f", "grblhal"),
    "grblhal awake": Case("grbl", "GrblHAL 1.1f", "grblhal", resets=False),
    "marlin": Case("marlin", "Marlin 1.1.1", "marlin"),
    "marlin awake": Case("marlin", "Marlin 1.1.1", "marlin", resets=False),
    "marlin at 250000": Case("marlin", "Marlin 1.1.9", _FastMarlin),
    "repetier": Case("marlin", "Repetier_0.92", _Repetier),
    "fabscan at 14400": Case("fabscan", "FabScanPi v.20210318 on board 2 (Ciclop)", "fabscan"),
    "fabscan on FTDI": Case("fabscan", "FabScanPi v.20210318", "fabscan", usb_id=(0x0403, 0x6001)),
    "fabscan awake": Case("fabscan", "FabScanPi v.20210318", "fabscan", resets=False),
    "fabscan at 57600": Case("fabscan", "FabScanPi v.20170701", "fabscan", _57600_FABSCAN),
    "fabscan at 115200": Case("fabscan", "FabScanPi v.20160101", "fabscan", _OLD_FABSCAN),
    "fabscan with a click": Case("fabscan", "FabScanPi v.20210318", "fabscan", noise=(0.1, 2)),
    "fabscan with noise": Case("fabscan", "FabScanPi v.20210318", "fabscan", noise=(0.6, 9), resets=False),
    "horus with a click": Case("horus", "Horus 0.2", "horus", noise=(0.1, 3)),
    "sardauscan": Case("sardauscan", "Sardauscan 0.1a", "sardauscan"),
    "sardauscan awake": Case("sardauscan", "Sardauscan", "sardauscan", resets=False),
    "fabscan100": Case("fabscan100", "FabScan100", "fabscan100"),
    "fabscan100 awake": Case("fabscan100", "FabScan100", "fabscan100", resets=False),
    "mute": Case("", "says nothing", _Mute),
    "gps": Case("", "a GPS receiver", _Gps),
    "modem": Case("", "unknown; it says", _Modem),
}


_MORE_TRIES = 2


@dataclass(frozen=True)
class Outcome:
    """What was found, and what the machine did meanwhile."""

    identity: Identity
    events: tuple[Event, ...]
    baud: int


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Outcome]:
    """All cases, several at a time: most of the time nothing is done but listening."""
    folder = tmp_path_factory.mktemp("ports")
    with ThreadPoolExecutor(ALL_AT_ONCE) as pool:
        found = pool.map(lambda item: _identified(item[1], folder / f"p{item[0]}"), enumerate(CASES.values()))
        outcomes = dict(zip(CASES, found, strict=True))
    # A question waits for a fifth of a second, in which a busy machine may come to nothing: ask again, alone.
    for number, (name, case) in enumerate(CASES.items()):
        for attempt in range(_MORE_TRIES):
            if outcomes[name].identity.driver != case.driver:
                outcomes[name] = _identified(case, folder / f"again{number}-{attempt}")
    return outcomes


def _identified(case: Case, link: Path) -> Outcome:
    plant = Plant(Wiring(3200.0))
    firmware = (
        FIRMWARES.make(case.board, plant=plant, **case.options)
        if isinstance(case.board, str)
        else case.board(plant)
    )
    with EmulatedPort(firmware, link, Clock(), resets_on_open=case.resets) as emulator:
        if case.told:
            with serial.Serial(str(link), 115200, timeout=3.0) as earlier:
                earlier.read_until(b"help]\r\n")
                earlier.write(case.told)
                earlier.read_until(b"ok\r\n")
            # The reset line of a port that is opened again at once does not fall.
            time.sleep(0.2)
        if not case.resets:
            started_s = 8.0 if case.board == "marlin" else 1.6
            wait_until(lambda: emulator.clock.now_s() > started_s, timeout_s=60.0)
            plant.switch(0, True, emulator.clock.now_s())
        before = len(plant.events)
        if case.noise is not None:
            threading.Timer(case.noise[0], emulator.garbage, [case.noise[1]]).start()
        identity = identify(str(link), case.usb_id)
        return Outcome(identity, tuple(plant.events)[before:], firmware.baud)


@pytest.mark.parametrize("name", CASES)
def test_each_board_is_recognised(outcomes: dict[str, Outcome], name: str) -> None:
    identity = outcomes[name].identity
    assert identity.driver == CASES[name].driver
    assert identity.firmware.startswith(CASES[name].firmware)
    if identity.driver:
        assert identity.baud == outcomes[name].baud
    else:
        assert identity.notes


@pytest.mark.parametrize("name", CASES)
def test_no_laser_is_switched_and_no_table_moved(outcomes: dict[str, Outcome], name: str) -> None:
    events = [event.what for event in outcomes[name].events if not event.what.startswith("driver")]
    # The first FabScan lights its laser when the port is opened, as often as it is; it is left dark.
    assert events == (["laser on", "laser off"] * 2 if name == "fabscan100" else [])


def test_what_the_driver_must_be_told_is_found(outcomes: dict[str, Outcome]) -> None:
    assert outcomes["fabscan at 14400"].identity.options["baud"] == 14400
    assert outcomes["marlin at 250000"].identity.options["baud"] == 250000
    assert "baud" not in outcomes["marlin"].identity.options
    for name in ("horus locked", "grbl locked"):
        assert "locked" in outcomes[name].identity.notes[0]
    assert not outcomes["grbl"].identity.notes
    assert "whole degrees" in outcomes["horus clone"].identity.notes[0]


@pytest.mark.parametrize("sent_at", [115200, 57600, 14400, 250000])
@pytest.mark.parametrize("question", [QUESTION, RESET])
def test_a_question_at_a_wrong_rate_is_no_command(question: bytes, sent_at: int) -> None:
    assert not _FABSCAN100_COMMANDS & _as_read(question, sent_at, 9600)
    for rate in (19200, 57600, 115200, 250000):
        if rate != sent_at:
            assert not _GRBL_COMMANDS & _as_read(question, sent_at, rate)


@pytest.mark.parametrize("rate", [19200, 57600, 115200, 250000])
def test_the_ping_for_the_first_fabscan_is_no_command_to_another(rate: int) -> None:
    assert not _GRBL_COMMANDS & _as_read(PING, 9600, rate)


def test_the_wrong_rate_is_modelled_as_boards_were_seen_to_read_it() -> None:
    assert _as_read(b"?\r\n", 115200, 115200) == {0x3F, 0x0D, 0x0A}
    # Recorded: a board's banner at 115200 is full of such bytes at a lower rate.
    assert _as_read(b"\r\nHorus 0.2 ['$' for help]\r\n", 115200, 57600) & {0xFF, 0xFE, 0xFC, 0xE1, 0xD6}


def test_a_board_behind_a_network_bridge_is_recognised(tmp_path: Path) -> None:
    with (
        EmulatedPort(FIRMWARES.make("horus", plant=Plant(Wiring(3200.0))), tmp_path / "p") as emulator,
        socket.create_server(("127.0.0.1", 0)) as server,
    ):
        bridge = threading.Thread(target=_bridge, args=(server, str(emulator.link)))
        bridge.start()
        identity = identify(f"socket://127.0.0.1:{server.getsockname()[1]}")
        bridge.join(10.0)
    assert identity.firmware == "Horus 0.2"


def test_a_port_that_another_program_has_is_said_to_be_busy(tmp_path: Path) -> None:
    with EmulatedPort(_Mute(Plant(Wiring(3200.0))), tmp_path / "p") as emulator:
        other = serial.Serial(str(emulator.link), exclusive=True)
        with pytest.raises(DeviceDenied, match="another program"):
            identify(str(emulator.link))
        other.close()


def test_a_port_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match="there is no port"):
        identify(str(tmp_path / "ttyUSB7"))


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("x")
    with pytest.raises(DeviceError, match="not a serial port"):
        identify(str(tmp_path / "notes"))


def test_without_permission_the_group_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(13, "could not open port: [Errno 13] Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(DeviceDenied, match="may not open") as told:
        identify(str(tmp_path / "ttyUSB0"))
    assert "usermod -a -G" in told.value.hint


def test_a_port_that_goes_away_meanwhile_is_lost(tmp_path: Path) -> None:
    with EmulatedPort(_Mute(Plant(Wiring(3200.0))), tmp_path / "p") as emulator:
        puller = threading.Timer(0.3, emulator.unplug)
        puller.start()
        with pytest.raises(DeviceLost):
            identify(str(emulator.link))
        puller.join()


_FABSCAN100_COMMANDS = set(range(200, 215))
# Coolant, spindle stop, and "go on", which may start a move; letters and digits of G-code.
_GRBL_COMMANDS = {0xA0, 0xA1, 0x9E, ord("~")} | set(b"GMgm")
_SAMPLES = 16


def _bridge(server: socket.socket, port: str) -> None:
    """Carry bytes between one caller and a port, until the caller leaves."""
    caller, _ = server.accept()
    with caller, serial.Serial(port, 115200, timeout=0) as board:
        while True:
            ready, _, _ = select.select([caller.fileno(), board.fileno()], [], [], 5.0)
            if caller.fileno() in ready:
                data = caller.recv(100)
                if not data:
                    return
                board.write(data)
            if board.fileno() in ready:
                caller.sendall(board.read(100))


def _as_read(data: bytes, sent_at: int, read_at: int) -> set[int]:
    """Every byte that a board may read at another rate, whenever its clock begins.

    It samples sixteen times a bit and decides by the middle three, as the AVR does; framing is not checked.
    """
    bits = [bit for byte in data for bit in (0, *((byte >> n) & 1 for n in range(8)), 1)]
    read = set()
    for phase in range(_SAMPLES):

        def level(sample: int, phase: int = phase) -> int:
            bit = math.floor((sample + phase / _SAMPLES) / _SAMPLES / read_at * sent_at)
            return bits[bit] if 0 <= bit < len(bits) else 1

        read |= set(_received(level, int(len(bits) / sent_at * read_at * _SAMPLES) + 1))
    return read


def _received(level: Callable[[int], int], samples: int) -> Iterator[int]:
    def middle(start: int) -> int:
        return int(sum(level(start + n) for n in (7, 8, 9)) >= 2)

    at = 0
    while at < samples:
        if level(at) or not level(at - 1) or middle(at):
            at += 1
            continue
        yield sum(middle(at + _SAMPLES * (n + 1)) << n for n in range(8))
        at += int(9.5 * _SAMPLES)
