"""A program that cannot put its lasers out any more has them put out."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from app.devices.serial_link import SerialLink
from app.devices.turntable import Farewell
from app.devices.watchdog import Watchdog
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_PROGRAM = """
import signal, sys, time
import serial
from app.devices.turntable import Farewell
from app.devices.watchdog import Watchdog

# Whoever starts the tests in the background has them ignore it.
signal.signal(signal.SIGINT, signal.default_int_handler)
port = serial.Serial(sys.argv[1], 115200, exclusive=True)
watchdog = Watchdog()
watchdog.guard(Farewell(sys.argv[1], 115200, ((b"0", 0.0),)))
port.write(b"1")
print("lit", flush=True)
time.sleep(600)
"""


class _Lamp(Firmware):
    """A laser that 1 lights and 0 puts out, on a board that no opening resets."""

    boot_s = 0.0

    def program(self) -> Iterator[float]:
        while True:
            byte = yield from self.read_byte()
            self.plant.switch(0, byte == ord("1"), self.now_s)

    def on_reset(self) -> None:
        self.plant.switch(0, False, self.now_s)


@pytest.fixture
def lamp(tmp_path: Path) -> Iterator[EmulatedPort]:
    with EmulatedPort(_Lamp(Plant(Wiring(1.0))), tmp_path / "port", resets_on_open=False) as port:
        yield port


@pytest.fixture
def program(lamp: EmulatedPort) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, str(lamp.link)], stdout=subprocess.PIPE, start_new_session=True
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"lit\n"
        _wait(lambda: _is_lit(lamp), 60.0)
        yield running
        running.kill()


def test_a_killed_program_leaves_no_laser_on(program: subprocess.Popen[bytes], lamp: EmulatedPort) -> None:
    program.kill()
    _wait(lambda: not _is_lit(lamp), 60.0)


def test_a_program_that_hangs_leaves_no_laser_on(
    program: subprocess.Popen[bytes], lamp: EmulatedPort
) -> None:
    os.kill(program.pid, signal.SIGSTOP)
    _wait(lambda: not _is_lit(lamp), 60.0)


def test_ctrl_c_does_not_end_the_watchdog_before_the_program(
    program: subprocess.Popen[bytes], lamp: EmulatedPort
) -> None:
    os.killpg(program.pid, signal.SIGINT)
    _wait(lambda: not _is_lit(lamp), 60.0)


def test_a_program_that_leaves_in_good_order_has_nothing_sent_behind_it(lamp: EmulatedPort) -> None:
    with Watchdog() as watchdog:
        watchdog.guard(Farewell(str(lamp.link), 115200, ((b"1", 0.0),)))
        was_running = watchdog.is_running
    assert was_running
    assert not watchdog.is_running
    assert not _is_lit(lamp)


_FAREWELL = """
import sys
from app.devices.watchdog_process import play

words = [("0", float(sys.argv[2])), ("0", 0.0)]
sys.exit(not play({"port": sys.argv[1], "baud": 115200, "stop_bits": 1, "words": words}, steps_aside=True))
"""


def test_a_new_program_waits_until_the_board_has_been_told_farewell(lamp: EmulatedPort) -> None:
    _light(lamp).close()
    with subprocess.Popen([sys.executable, "-c", _FAREWELL, str(lamp.link), "1.5"]) as farewell:
        _wait(lambda: not _is_lit(lamp), 60.0)
        with closing(_light(lamp)):
            assert farewell.wait(60.0) == 0
            assert _is_lit(lamp)


def test_no_farewell_reaches_a_board_that_another_program_has_connected(lamp: EmulatedPort) -> None:
    with closing(_light(lamp)):
        told = subprocess.run([sys.executable, "-c", _FAREWELL, str(lamp.link), "0"], check=False)
        assert told.returncode == 1
        assert _is_lit(lamp)


def test_a_watchdog_without_a_board_starts_nothing() -> None:
    with Watchdog() as watchdog:
        watchdog.guard(None)
        assert not watchdog.is_running


def _light(lamp: EmulatedPort) -> SerialLink:
    link = SerialLink(str(lamp.link), 115200, "lamp")
    link.open()
    link.write(b"1")
    _wait(lambda: _is_lit(lamp), 60.0)
    return link


def _is_lit(lamp: EmulatedPort) -> bool:
    return bool(lamp.firmware.plant.at(lamp.clock.now_s()).outputs_on)


def _wait(is_so: Callable[[], bool], timeout_s: float) -> None:
    ends = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.01)
