"""`turnscan serve --check`: whether a server would start, and what it would miss. Nothing is switched."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

from app.access.access import Access
from app.calibration.store import CalibrationStore
from app.checkup.finding import Finding, State
from app.devices.bench import Bench
from app.devices.bench_file import SIMULATED, BenchDescription
from app.devices.ports import join_group, resolve_port
from app.devices.video_nodes import VideoNodes
from app.errors import DeviceError, ScannerError
from app.files import make_folder, reason
from app.serving.addresses import listening, reachable_at
from app.serving.certificate import own_certificate
from app.settings import Settings

_LEAST_FREE_BYTES = 1_000_000_000


def check_server(settings: Settings, description: BenchDescription | ScannerError) -> list[Finding]:
    """One finding for each thing that a server needs; BAD where it would not start, or not as asked for.

    Args:
        settings: it would start with.
        description: of its bench, or why there is none.
    """
    checks: tuple[tuple[str, Callable[[], Iterator[Finding]]], ...] = (
        ("folder", lambda: _folder(settings)),
        ("log", lambda: _log(settings)),
        ("bench", lambda: _bench(description)),
        ("calibration", lambda: _calibration(settings, description)),
        ("port", lambda: _port(settings)),
        ("password", lambda: _password(settings)),
        ("certificate", lambda: _certificate(settings)),
        ("name", lambda: _name(settings)),
    )
    findings: list[Finding] = []
    for name, check in checks:
        try:
            findings.extend(check())
        except ScannerError as error:
            findings.append(Finding(name, State.BAD, _sentence(error), error.hint))
    return findings


def _folder(settings: Settings) -> Iterator[Finding]:
    folder = settings.folder.resolve()
    make_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        advice = "Let this user write there, or name another folder with --folder."
        yield Finding("folder", State.BAD, f"{folder} cannot be written ({reason(error)}).", advice)
        return
    free = shutil.disk_usage(folder).free
    text = f"{folder} can be written; {free / 1e9:.1f} GB are free."
    if free < _LEAST_FREE_BYTES:
        yield Finding("folder", State.ATTENTION, text, "A scan takes about 200 MB: make some room.")
    else:
        yield Finding("folder", State.OK, text)


def _log(settings: Settings) -> Iterator[Finding]:
    # That of the folder is made with it.
    folder = settings.folder if settings.log_file is None else settings.log_file.parent
    if os.access(folder, os.W_OK | os.X_OK) and not settings.log.is_dir():
        yield Finding("log", State.OK, f"The log goes to {settings.log}.")
    else:
        yield Finding(
            "log", State.ATTENTION, f"The log cannot be written to {settings.log}.",
            "It goes to the terminal only; name another file with --log-file.",
        )  # fmt: skip


def _bench(description: BenchDescription | ScannerError) -> Iterator[Finding]:
    if isinstance(description, ScannerError):
        yield Finding("bench", State.ATTENTION, _sentence(description), description.hint)
        return
    with Bench.build(description):
        yield Finding("bench", State.OK, f"The bench {description.name!r} makes sense.")
    yield from _board_port(description)
    yield from _camera(description)


def _board_port(description: BenchDescription) -> Iterator[Finding]:
    entry = description.turntable
    name = entry.options.get("port")
    if entry.driver == SIMULATED or not isinstance(name, str) or "://" in name:
        yield Finding("board", State.OK, f"The board ({entry.driver}) needs no port of this machine.")
        return
    try:
        path = resolve_port(name)
    except DeviceError as error:
        yield Finding("board", State.ATTENTION, _sentence(error), error.hint)
        return
    yield _device("board", path, "Plug it in, or see `turnscan devices --names-only` for what is there.")


def _camera(description: BenchDescription) -> Iterator[Finding]:
    entry = description.camera
    if entry.driver == "uvc":
        device = entry.options.get("device", 0)
        if VideoNodes().find(device):
            path = f"/dev/video{device}" if isinstance(device, int) else str(device)
            yield _device("camera", path, "")
        else:
            yield Finding(
                "camera", State.ATTENTION, f"The camera {device} is not there.",
                "Plug it in, or see `turnscan devices --names-only` for what is there.",
            )  # fmt: skip
    elif entry.driver == "folder" and not Path(str(entry.options.get("folder", ""))).exists():
        folder = entry.options.get("folder", "")
        yield Finding(
            "camera", State.ATTENTION, f"There is no folder {folder}.", "Correct it in the bench file."
        )
    else:
        yield Finding(
            "camera", State.OK, f"The camera ({entry.driver}) is looked for when the server starts."
        )


def _device(what: str, path: str, advice: str) -> Finding:
    if not Path(path).exists():
        return Finding(what, State.ATTENTION, f"{path} is not there.", advice)
    if not os.access(path, os.R_OK | os.W_OK):
        return Finding(what, State.ATTENTION, f"This user may not open {path}.", join_group(path))
    return Finding(what, State.OK, f"{path} is there and may be opened.")


def _calibration(settings: Settings, description: BenchDescription | ScannerError) -> Iterator[Finding]:
    store = CalibrationStore(settings.calibrations)
    if not store.paths():
        is_simulated = isinstance(description, BenchDescription) and description.is_simulated
        yield Finding(
            "calibration",
            State.OK if is_simulated else State.ATTENTION,
            f"There is no calibration in {settings.calibrations} yet.",
            "" if is_simulated else "Calibrate in the page, or with `turnscan calibrate --bench bench.toml`.",
        )
        return
    record = store.current()
    yield Finding("calibration", State.OK, f"The one in use was made on {record.created:%Y-%m-%d}.")


def _port(settings: Settings) -> Iterator[Finding]:
    listening(settings.host, settings.port).close()
    where = (
        "this machine only" if settings.is_local else ", ".join(reachable_at(settings.host)) or settings.host
    )
    yield Finding("port", State.OK, f"Port {settings.port} is free; it would be served to {where}.")


def _password(settings: Settings) -> Iterator[Finding]:
    has_password = Access.open(settings.folder).has_password
    if has_password:
        yield Finding("password", State.OK, "A password is set.")
    elif settings.is_local:
        yield Finding("password", State.OK, "No password is needed: only this machine is served.")
    else:
        yield Finding(
            "password", State.ATTENTION, "No password is set, and other machines are refused without one.",
            "Set one with `turnscan password`, or start in a terminal, where one is made and shown.",
        )  # fmt: skip


def _certificate(settings: Settings) -> Iterator[Finding]:
    if settings.certificate is not None and settings.key is not None:
        found = own_certificate(settings.certificate, settings.key)
        yield Finding(
            "certificate", State.OK, f"{settings.certificate} is valid until {found.ends:%Y-%m-%d}."
        )
    elif settings.tls:
        yield Finding("certificate", State.OK, "The server signs its certificate itself.")
    elif not settings.is_local:
        yield Finding(
            "certificate", State.ATTENTION, "Nothing is encrypted on the network.",
            "Use --tls where you do not trust everybody in it.",
        )  # fmt: skip


def _name(settings: Settings) -> Iterator[Finding]:
    if settings.is_local or not settings.mdns:
        return
    if find_spec("zeroconf") is None:
        yield Finding(
            "name", State.ATTENTION, f"The server cannot be found as {settings.name}.local.",
            "Install zeroconf: `pip install 'turnscan[mdns]'`; or use its address.",
        )  # fmt: skip
    else:
        yield Finding("name", State.OK, f"The server will be found as {settings.name}.local.")


def _sentence(error: ScannerError) -> str:
    return error.message if error.message.endswith(".") else f"{error.message}."
