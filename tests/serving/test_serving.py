"""Settings, certificates, logs, codes, names and signs of life: each part of serving alone."""

import json
import logging
import os
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from app.devices.bench_file import parse_bench, simulated_description
from app.devices.camera import CameraState
from app.errors import BenchFileError, OptionError, OutputError
from app.serving import certificate as certificates
from app.serving.addresses import Reach, listening, reachable_at
from app.serving.certificate import own_certificate, self_signed
from app.serving.check import check_server
from app.serving.discovery import Discovery
from app.serving.health import is_healthy
from app.serving.logs import begin_logging
from app.serving.notify import Notifier
from app.serving.pulse import Pulse
from app.serving.welcome import login_link, network_lines, password_lines, qr_code
from app.settings import Settings, read_service_manager, read_settings

_LOADED_BY_THE_START = """
import sys
import app.cli.serve, app.main
from app.api.versioned import versioned_routes
versioned_routes()
loaded = {name.partition(".")[0] for name in sys.modules}
print(*loaded & {"scipy", "numba", "matplotlib", "reportlab", "cryptography", "zeroconf"})
"""


def test_the_first_answer_waits_for_no_library_that_only_work_needs() -> None:
    told = subprocess.run(
        [sys.executable, "-c", _LOADED_BY_THE_START], capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == []


def test_an_option_wins_over_the_environment_and_that_over_the_usual() -> None:
    environment = {"TURNSCAN_PORT": "9000", "TURNSCAN_TLS": "yes", "TURNSCAN_NAME": "", "PATH": "/bin"}
    settings = read_settings({"port": 9001, "host": None}, environment)
    assert (settings.port, settings.tls, settings.name, settings.host) == (
        9001,
        True,
        "turnscan",
        "127.0.0.1",
    )
    assert settings.is_local
    assert not read_settings({"host": "0.0.0.0"}, {}).is_local
    assert read_settings({"host": "localhost"}, {}).is_local
    assert read_settings({}, {"TURNSCAN_PROXY": "127.0.0.1, 10.0.0.0/8"}).proxy == "127.0.0.1/32,10.0.0.0/8"


@pytest.mark.parametrize(
    ("options", "environment", "said"),
    [
        ({}, {"TURNSCAN_PORT": "many"}, "TURNSCAN_PORT cannot be 'many'"),
        ({"port": 99999}, {"TURNSCAN_PORT": "80"}, "--port cannot be 99999"),
        ({"log_level": "loud"}, {}, "--log-level cannot be 'loud'"),
        ({"host": "evil.example"}, {}, "--host cannot be 'evil.example'"),
        ({"proxy": "my-proxy"}, {}, "--proxy cannot be 'my-proxy'"),
        ({"upload_bytes": 5}, {}, "--upload-bytes cannot be 5"),
        ({"name": "two words"}, {}, "--name cannot be 'two words'"),
        ({}, {"TURNSCAN_PROT": "80"}, "There is no setting TURNSCAN_PROT"),
        ({"certificate": "a.pem"}, {}, "A certificate and its key go together"),
    ],
)
def test_a_setting_that_cannot_be_is_named(
    options: dict[str, object], environment: dict[str, str], said: str
) -> None:
    with pytest.raises(OptionError, match="^" + said.replace("(", "\\(")):
        read_settings(options, environment)


def test_a_taken_port_is_told_with_a_free_one_to_try() -> None:
    with listening("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OptionError, match=f"Port {port} is taken") as caught:
            listening("127.0.0.1", port)
    assert "--port" in caught.value.hint
    with pytest.raises(OptionError, match="cannot be served"):
        listening("203.0.113.77", 0)
    assert reachable_at("127.0.0.1") == []
    assert all(":" not in address for address in reachable_at("0.0.0.0"))


def test_a_certificate_is_kept_until_names_change_or_its_end_is_near(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = self_signed(tmp_path / "tls", ["localhost", "127.0.0.1", "192.0.2.7"])
    assert first.key.stat().st_mode & 0o777 == 0o600
    assert (
        self_signed(tmp_path / "tls", ["localhost", "192.0.2.7", "127.0.0.1"]).fingerprint
        == first.fingerprint
    )
    other = self_signed(tmp_path / "tls", ["localhost", "192.0.2.8"])
    assert other.fingerprint != first.fingerprint
    monkeypatch.setattr(certificates, "_RENEWED_BEFORE", certificates._LASTS)
    with pytest.raises(OutputError):
        # Every new one would be near its end, too.
        self_signed(tmp_path / "tls", ["localhost", "192.0.2.8"])
    assert own_certificate(other.certificate, other.key).ends > other.ends.replace(year=2000)
    (tmp_path / "key.pem").write_text("no key")
    with pytest.raises(OptionError, match="cannot be used"):
        own_certificate(other.certificate, tmp_path / "key.pem")
    context = ssl.create_default_context(cafile=str(other.certificate))
    assert context.cert_store_stats()["x509"] == 1


def test_the_code_on_the_terminal_leads_to_the_login_page(tmp_path: Path) -> None:
    reach = Reach("https", ("192.0.2.2", "turnscan.local"), 8000)
    link = login_link(reach, "a-key_that-Opens-once-0123456789")
    assert link == "https://192.0.2.2:8000/login#key=a-key_that-Opens-once-0123456789"
    qr_code(link).save(str(tmp_path / "code.png"), scale=6, border=4)
    assert _read_code(cv2.imread(str(tmp_path / "code.png"))) == link
    drawn = [line[8:-4] for line in password_lines("four-words", link) if line.startswith("\033")]
    halves = {"█": (255, 255), "▀": (255, 0), "▄": (0, 255), " ": (0, 0)}
    rows = [row for line in drawn for row in zip(*(halves[each] for each in line), strict=True)]
    picture = np.kron(np.array(rows, np.uint8), np.ones((8, 8), np.uint8))
    assert _read_code(picture) == link
    assert "  https://turnscan.local:8000" in network_lines(reach, "AB:CD")
    assert any("Nothing is encrypted" in line for line in network_lines(replace(reach, scheme="http"), ""))


@pytest.fixture
def usual_log() -> Iterator[logging.Logger]:
    """The root logger, which is afterwards as it was."""
    root = logging.getLogger()
    before = tuple(root.handlers), root.level, logging.raiseExceptions
    yield root
    root.handlers[:] = before[0]
    root.setLevel(before[1])
    logging.raiseExceptions = before[2]


def test_ten_thousand_lines_are_kept_in_files_of_bounded_size_and_without_secrets(
    tmp_path: Path, usual_log: logging.Logger, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.serving.logs._FILE_BYTES", 400_000)
    end = begin_logging(tmp_path / "logs" / "a.log", is_json=True, to_terminal=False)
    usual_log.warning(
        "GET /x?token=hushhush1 with turnscan_ABCDEFGHIJKLMNOPQRST and Authorization: Bearer hushhush2"
    )
    for number in range(10_000):
        logging.getLogger("app.some.part").info("line %d, as long as lines in a log usually are", number)
    end()
    files = sorted((tmp_path / "logs").iterdir())
    assert 2 <= len(files) <= 6
    text = "".join(file.read_text() for file in files)
    lines = [json.loads(line) for line in text.splitlines()]
    assert all(file.stat().st_size <= 400_000 for file in files)
    assert {line["logger"] for line in lines} >= {"app.some.part"}
    assert sum("as long as" in line["message"] for line in lines) == 10_000
    assert "hushhush" not in text
    assert "ABCDEFGH" not in text


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no disk that is always full")
def test_a_full_disk_costs_the_log_and_nothing_else(
    tmp_path: Path, usual_log: logging.Logger, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.log").symlink_to("/dev/full")
    end = begin_logging(tmp_path / "a.log", to_terminal=False)
    for number in range(10_000):
        usual_log.error("line %d of %s", number, "too", "many")
    end()
    assert capfd.readouterr() == ("", "")
    with pytest.raises(OutputError):
        begin_logging(Path("/dev/null/logs/a.log"))


def test_the_service_manager_is_told_and_nobody_where_there_is_none(tmp_path: Path) -> None:
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.settimeout(60.0)
        said = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "6000000", "WATCHDOG_PID": str(os.getpid())}
        notifier = Notifier(*read_service_manager(said))
        assert notifier.watchdog_s == 6.0
        notifier.ready("Serving")
        notifier.alive()
        notifier.stopping()
        assert [manager.recv(200) for _ in range(3)] == [
            b"READY=1\nSTATUS=Serving",
            b"WATCHDOG=1",
            b"STOPPING=1",
        ]
    notifier.alive()
    Notifier().ready("to nobody")
    assert read_service_manager(said | {"WATCHDOG_PID": "1"})[1] == 0.0


def test_a_camera_whose_thread_hangs_is_no_sign_of_life() -> None:
    now_s, state = 100.0, CameraState(is_connected=True)
    pulse = Pulse(lambda: state, list, lambda: now_s)
    assert pulse.beats()
    state = CameraState(is_connected=True, is_frozen=True)
    assert pulse.beats()
    now_s += 29.0
    assert pulse.beats()
    now_s += 2.0
    assert not pulse.beats()
    # One that is being reopened is taken care of.
    state = CameraState(is_connected=False)
    assert pulse.beats()


def test_the_server_is_found_in_the_network() -> None:
    zeroconf = pytest.importorskip("zeroconf")
    with (
        Discovery("turnscan-test", 8123, is_encrypted=True, addresses=["127.0.0.1"]) as announced,
        zeroconf.Zeroconf(interfaces=["127.0.0.1"]) as listener,
    ):
        if not _wait(announced.is_announced.is_set, 20.0):
            pytest.skip("this machine has no multicast on the loopback interface")
        found = _within(
            lambda: listener.get_service_info("_http._tcp.local.", "turnscan-test._http._tcp.local.", 1000),
            60.0,
        )
    assert (found.port, found.server) == (8123, "turnscan-test.local.")
    assert found.parsed_addresses() == ["127.0.0.1"]
    assert found.properties[b"scheme"] == b"https"


def test_a_check_says_what_is_missing_and_what_to_do(tmp_path: Path) -> None:
    settings = Settings(tmp_path / "new", port=0)
    findings = {each.check: each for each in check_server(settings, simulated_description())}
    assert {each.state.value for each in findings.values()} == {"ok"}
    bench = parse_bench(
        b'[turntable]\ndriver = "horus"\nport = "/dev/not-there"\n[camera]\ndriver = "uvc"\ndevice = 77\n',
        "x",
    )
    findings = {each.check: each for each in check_server(replace(settings, host="0.0.0.0"), bench)}
    assert findings["board"].sentence == "/dev/not-there is not there."
    assert findings["camera"].sentence == "The camera 77 is not there."
    assert "turnscan password" in findings["password"].advice
    with listening("127.0.0.1", 0) as taken:
        missing = tmp_path / "missing.pem"
        bad = replace(
            settings,
            port=taken.getsockname()[1],
            certificate=missing,
            key=missing,
            folder=Path("/dev/null/x"),
        )
        reason = BenchFileError("bench.toml", "is not here", "Write one.")
        found = {each.check: each for each in check_server(bad, reason)}
    assert {name for name, each in found.items() if each.state.value == "bad"} >= {
        "folder",
        "port",
        "certificate",
    }
    assert all(each.advice for each in found.values() if each.is_trouble)
    assert not is_healthy(settings)


def _read_code(picture: Any) -> str:
    return str(cv2.QRCodeDetector().detectAndDecode(picture)[0])


def _wait(is_so: Callable[[], bool], timeout_s: float) -> bool:
    return bool(_within(is_so, timeout_s, is_needed=False))


def _within(ask: Callable[[], Any], timeout_s: float, *, is_needed: bool = True) -> Any:
    ends = time.monotonic() + timeout_s
    while not (answer := ask()) and time.monotonic() < ends:
        time.sleep(0.01)
    assert answer or not is_needed
    return answer
