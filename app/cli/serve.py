"""`turnscan serve`: the scanner for programs and pages, on this machine or in its network."""

import contextlib
import gc
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.access.access import Access
from app.cli.bench import BENCH_FILE, bench_description
from app.cli.console import console, say, warn
from app.devices.bench_file import BenchDescription
from app.errors import BenchFileError, DeviceError, OptionError, OutputError, ScannerError
from app.serving.addresses import Reach, listening, reachable_at
from app.serving.welcome import local_lines, login_link, network_lines, password_lines, silent_lines
from app.settings import Settings, read_service_manager, read_settings

if TYPE_CHECKING:
    import socket

    from app.serving.certificate import Certificate

_ALL_WELL, _TO_LOOK_AT, _WILL_NOT_START = 0, 1, 2


def serve_command(
    bench: Annotated[
        str | None, typer.Option(help="Bench file, or simulated, or simulated:grbl; by default bench.toml.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option(help="Where scans, jobs and calibrations are kept; by default here.")
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="Address to serve at; 0.0.0.0 is all. By default this machine only.")
    ] = None,
    port: Annotated[int | None, typer.Option(help="By default 8000; 0 takes any.")] = None,
    name: Annotated[
        str | None, typer.Option(help="To be found by in the network, as NAME.local; by default turnscan.")
    ] = None,
    tls: Annotated[
        bool | None, typer.Option("--tls/--no-tls", help="Encrypt, with a certificate made here.")
    ] = None,
    certificate: Annotated[Path | None, typer.Option(help="Encrypt with this one (PEM).")] = None,
    key: Annotated[Path | None, typer.Option(help="Of the certificate (PEM).")] = None,
    mdns: Annotated[bool | None, typer.Option("--mdns/--no-mdns", help="Be found by name.")] = None,
    proxy: Annotated[
        str | None,
        typer.Option(
            help="Address of a reverse proxy; what it says of where requests come from is believed."
        ),
    ] = None,
    upload_bytes: Annotated[
        int | None, typer.Option(help="The largest scan that is taken in over the network; by default 4 GB.")
    ] = None,
    log_file: Annotated[Path | None, typer.Option(help="By default logs/turnscan.log in the folder.")] = None,
    log_json: Annotated[
        bool | None, typer.Option("--log-json/--log-plain", help="Each line of the log a JSON object.")
    ] = None,
    log_level: Annotated[
        str | None, typer.Option(help="debug, info, warning or error; by default info.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Say what is missing and end. Nothing is switched or moved.")
    ] = False,
) -> int:
    """Serve the scanner until Ctrl-C: its pages, its API, live pictures and the 3D view.

    Each option may be given as a variable of the environment as well: TURNSCAN_PORT is --port.
    """
    given = {
        "bench": bench, "folder": folder, "host": host, "port": port, "name": name, "tls": tls,
        "certificate": certificate, "key": key, "mdns": mdns, "log_file": log_file, "log_json": log_json,
        "log_level": log_level, "proxy": proxy, "upload_bytes": upload_bytes,
    }  # fmt: skip
    settings = with_bench(read_settings(given))
    description = _description(settings)
    if check:
        return _checked(settings, description)
    serve(settings, description)
    return _ALL_WELL


def serve(settings: Settings, description: BenchDescription | ScannerError) -> None:
    """Serve until a signal comes.

    Args:
        settings: see there.
        description: of the bench, or why there is none; the server then says so and does without.

    Raises:
        OptionError: the port or the certificate cannot be had.
    """
    with contextlib.ExitStack() as stack:
        # What is loaded until the first answer stays; to look for garbage in it takes a tenth of the time.
        gc.disable()
        stack.callback(gc.enable)
        # Whoever asks from now on waits for the answer instead of being refused.
        bound = listening(settings.host, settings.port)
        stack.callback(bound.close)
        stack.callback(_begun_log(settings))
        certificate = _certificate(settings)
        access = Access.open(settings.folder)
        _run(settings, description, access, bound, certificate)
    _leave_setting_up()


def _run(
    settings: Settings,
    description: BenchDescription | ScannerError,
    access: Access,
    bound: "socket.socket",
    certificate: "Certificate | None",
) -> None:
    import uvicorn

    from app.main import create_app
    from app.serving.discovery import Discovery
    from app.serving.notify import Notifier
    from app.serving.pulse import Pulse
    from app.serving.server import Server
    from app.viewer.proxy import SOCKET_OPTIONS

    application = create_app(settings, description, access, lambda: _hosts(settings))
    served = application.state.services
    reach = _reach(settings, bound.getsockname()[1])

    def quieten() -> None:
        served.runner.close()
        # A board that is gone already was made safe when it was let go.
        with contextlib.suppress(DeviceError):
            served.bench.make_safe()

    with contextlib.ExitStack() as stack:

        def ready() -> None:
            gc.freeze()
            gc.enable()
            _greet(settings, reach, access, certificate)
            if settings.mdns and not settings.is_local:
                found = Discovery(
                    settings.name, reach.port, is_encrypted=settings.is_encrypted,
                    addresses=reachable_at(settings.host),
                )  # fmt: skip
                stack.enter_context(found)

        config = uvicorn.Config(
            application, log_config=None, log_level="warning", access_log=False, lifespan="on",
            ssl_certfile=certificate.certificate if certificate else None,
            ssl_keyfile=certificate.key if certificate else None,
            proxy_headers=bool(settings.proxy), forwarded_allow_ips=settings.proxy or None,
            **SOCKET_OPTIONS,
        )  # fmt: skip
        server = Server(
            config, quieten=quieten, notifier=Notifier(*read_service_manager()), on_ready=ready,
            is_alive=Pulse(lambda: served.bench.camera.state, served.runner.jobs).beats,
        )  # fmt: skip
        server.run_until_told([bound])


def _leave_setting_up() -> None:
    """End at once where devices are still being connected: what is compiled then cannot be broken off.

    All that matters has been closed; and the interpreter does not survive its own end in such a thread.
    """
    from app.main import SETTING_UP

    if any(thread.name == SETTING_UP for thread in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(_ALL_WELL)


def with_bench(settings: Settings) -> Settings:
    """Where no bench is named, the one that was chosen in the page, else that of the current folder."""
    found = (path for path in (settings.folder / BENCH_FILE, BENCH_FILE) if path.is_file())
    return settings if settings.bench else replace(settings, bench=str(next(found, "")))


def _description(settings: Settings) -> BenchDescription | ScannerError:
    if not settings.bench:
        return BenchFileError(
            str(BENCH_FILE),
            "is not here, so there is no bench yet",
            "Write one with `turnscan devices --write bench.toml`, or start with `--bench simulated`.",
        )
    try:
        return bench_description(settings.bench)
    except (BenchFileError, OptionError) as error:
        return error


def _begun_log(settings: Settings) -> Callable[[], None]:
    """The log as it is wished, or to the terminal alone where its file cannot be written."""
    from app.serving.logs import begin_logging

    try:
        return begin_logging(settings.log, level=settings.log_level, is_json=settings.log_json)
    except OutputError as error:
        warn([f"There will be no log file. {error.message}."])
        return begin_logging(None, level=settings.log_level, is_json=settings.log_json)


def _reach(settings: Settings, port: int) -> Reach:
    return Reach("https" if settings.is_encrypted else "http", tuple(_hosts(settings) or ["localhost"]), port)


def _hosts(settings: Settings) -> list[str]:
    """Names and addresses for other machines."""
    if settings.is_local:
        return []
    return [*reachable_at(settings.host), *([f"{settings.name}.local"] if settings.mdns else [])]


def _certificate(settings: Settings) -> "Certificate | None":
    if not settings.is_encrypted:
        return None
    from app.serving.certificate import own_certificate, self_signed
    from app.serving.discovery import host_name

    if settings.certificate is not None and settings.key is not None:
        return own_certificate(settings.certificate, settings.key)
    names = ["localhost", "127.0.0.1", "::1", f"{settings.name}.local", *reachable_at(settings.host)]
    names += [host_name(), f"{host_name()}.local"] if host_name() else []
    return self_signed(settings.folder / "tls", names)


def _greet(settings: Settings, reach: Reach, access: Access, certificate: "Certificate | None") -> None:
    """Where the server is, and how to get in. Secrets go to standard output, and only to a terminal."""
    if settings.is_local:
        say(local_lines(reach))
        return
    is_own = certificate is not None and settings.certificate is None
    say(network_lines(reach, certificate.fingerprint if is_own and certificate else ""))
    if sys.stdout.isatty():
        password = "" if access.has_password else access.make_password()
        link = login_link(reach, access.one_time_key())
        typer.echo("\n".join(password_lines(password, link)))
    elif not access.has_password:
        warn(silent_lines())


def _checked(settings: Settings, description: BenchDescription | ScannerError) -> int:
    from app.checkup.finding import State
    from app.serving.check import check_server

    marks = {State.OK: "[green]ok  [/]", State.ATTENTION: "[yellow]look[/]", State.BAD: "[bold red]bad [/]"}
    findings = check_server(settings, description)
    for finding in findings:
        console.print(marks[finding.state], end=" ")
        say([f"{finding.check}: {finding.sentence}"])
        if finding.advice:
            say([f"     {finding.advice}"])
    worst = {finding.state for finding in findings}
    if State.BAD in worst:
        return _WILL_NOT_START
    return _TO_LOOK_AT if State.ATTENTION in worst else _ALL_WELL
