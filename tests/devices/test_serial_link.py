"""The link under every driver."""

import os
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from turntable_contract import wait_until

from app.devices.port_lock import is_shared, shared
from app.devices.ports import SerialPort
from app.devices.serial_link import SerialLink
from app.errors import DeviceDenied, DeviceError, DeviceLost, DeviceNotFound, DeviceTimeout, MoveStopped
from app.simulation.clock import Clock
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_OK = re.compile(rb"ok\r\n")


class _Polite(Firmware):
    """Greets, and says ok to every line."""

    def program(self) -> Iterator[float]:
        self.say("hello\r\n")
        while True:
            byte = yield from self.read_byte()
            if byte == ord("\n"):
                self.say("ok\r\n")

    def on_reset(self) -> None:
        """It has no pins."""


@pytest.fixture
def board(tmp_path: Path) -> Iterator[EmulatedPort]:
    with EmulatedPort(_Polite(Plant(Wiring(1.0))), tmp_path / "port", Clock(10.0)) as board:
        yield board


@pytest.fixture
def link(board: EmulatedPort) -> Iterator[SerialLink]:
    link = SerialLink(str(board.link), 115200, "board")
    link.open()
    link.read_line(3.0, "the banner")
    yield link
    link.close()


def test_lines_go_out_and_come_back(link: SerialLink) -> None:
    for _ in range(3):
        link.write(b"anything\n")
        assert link.read_line(3.0, "anything") == "ok"


def test_silence_is_a_timeout_that_names_the_command(link: SerialLink) -> None:
    with pytest.raises(DeviceTimeout, match="'nothing'") as told:
        link.wait_for(_OK, 0.05, "nothing")
    assert told.value.timeout_s == 0.05


def test_late_answers_are_thrown_away(link: SerialLink) -> None:
    link.write(b"one\n")
    wait_until(lambda: bool(link._buffer))
    assert link.discard() == b"ok\r\n"
    with pytest.raises(DeviceTimeout):
        link.wait_for(_OK, 0.05, "two")


def test_an_interrupt_reaches_who_waits_and_nobody_later(link: SerialLink) -> None:
    raised: list[DeviceError] = []

    is_talking = threading.Event()

    def wait() -> None:
        with link.dialogue():
            is_talking.set()
            try:
                link.wait_for(_OK, 20.0, "a long move")
            except MoveStopped as error:
                raised.append(error)

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    assert is_talking.wait(5.0)
    link.interrupt()
    waiting.join(5.0)
    assert len(raised) == 1
    with link.dialogue():
        link.write(b"next\n")
        assert link.read_line(3.0, "next") == "ok"


def test_an_unplugged_port_is_noticed_without_a_word(link: SerialLink, board: EmulatedPort) -> None:
    board.unplug()
    wait_until(lambda: not link.is_open)
    with pytest.raises(DeviceLost):
        link.write(b"anything\n")
    with pytest.raises(DeviceLost):
        link.wait_for(_OK, 5.0, "anything")


def test_a_second_program_is_told(link: SerialLink, board: EmulatedPort) -> None:
    with pytest.raises(DeviceDenied, match="another program"):
        SerialLink(str(board.link), 115200, "board").open()


def test_an_address_in_the_network_is_one_program_s_and_waited_for_while_it_is_told_farewell() -> None:
    with socket.create_server(("127.0.0.1", 0)) as bridge:
        port = f"socket://127.0.0.1:{bridge.getsockname()[1]}"
        first, second = SerialLink(port, 115200, "board"), SerialLink(port, 115200, "board")
        with closing(first):
            first.open()
            with pytest.raises(DeviceDenied, match="another program"):
                second.open()
            assert not is_shared(port)
        opening = threading.Thread(target=second.open, daemon=True)
        with closing(second):
            with shared(port):
                opening.start()
                opening.join(0.3)
                assert not second.is_open
            wait_until(lambda: second.is_open)


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [("missing", DeviceNotFound, "there is no port"), ("letter.txt", DeviceError, "is not a serial port")],
)
def test_what_is_no_port_is_named(tmp_path: Path, name: str, error: type[DeviceError], said: str) -> None:
    (tmp_path / "letter.txt").write_text("dear aunt")
    with pytest.raises(error, match=said):
        SerialLink(str(tmp_path / name), 115200, "board").open()


def test_an_adapter_that_comes_back_as_another_node_is_found_again(board: EmulatedPort) -> None:
    def ports() -> list[SerialPort]:
        return [SerialPort(board.path, str(board.link))] if board.path else []

    link = SerialLink(board.path, 115200, "board", ports=ports)
    first = board.path
    link.open()
    board.unplug()
    wait_until(lambda: not link.is_open)
    link.close()
    # Something else takes the number that it had, until it is back.
    taken = os.openpty()
    board.plug_in()
    for handle in taken:
        os.close(handle)
    if board.path == first:
        pytest.skip("the system gave it the same number again")
    link.open()
    assert link.read_line(3.0, "the banner") == "hello"
    link.close()
