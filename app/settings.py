"""What the server is told when it starts; the only place where the environment is read."""

import ipaddress
import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError
from pydantic.dataclasses import dataclass

from app.errors import OptionError

PREFIX = "TURNSCAN_"
"""Of every variable: `TURNSCAN_PORT` is the port."""
_OF_THE_BUILD = "TURNSCAN_WITHOUT_PAGES"
LOOPBACK = "127.0.0.1"
UPLOAD_BYTES = 4_000_000_000
LogLevel = Literal["debug", "info", "warning", "error"]
_LABEL = r"^[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?$"


def _addresses(text: str) -> str:
    """Of machines or networks, separated by commas."""
    return ",".join(str(ipaddress.ip_network(part.strip())) for part in text.split(",") if part.strip())


def _one_address(host: str) -> str:
    return LOOPBACK if host.strip().lower() == "localhost" else str(ipaddress.ip_address(host.strip("[] ")))


@dataclass(frozen=True, slots=True)
class Settings:
    """Plain values; whoever starts the server makes them.

    Attributes:
        folder: holds `scans/`, `jobs/`, `calibration_store/` and `logs/`; made where it is missing.
        bench: a bench file, `simulated`, or `simulated:` and a dialect; empty for bench.toml, if it is there.
        host: address of the interface that is served; `0.0.0.0` or `::` for all.
        port: on it; 0 for any that is free.
        name: the server is found as `NAME.local`.
        tls: whether to encrypt, with a certificate made here where no other is named.
        certificate: file of a certificate with those that vouch for it, PEM.
        key: file of its key, PEM.
        mdns: whether to be found by name.
        proxy: addresses of reverse proxies that are believed where a request comes from; usually none.
        upload_bytes: how much a scan may be that comes in over the network.
        log_file: where the log goes; the folder's `logs/turnscan.log` where not given.
        log_json: whether each line of the log is a JSON object.
        log_level: what is too unimportant to be logged.
    """

    folder: Path = Path()
    bench: str = ""
    host: Annotated[str, AfterValidator(_one_address)] = LOOPBACK
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    name: Annotated[str, Field(pattern=_LABEL)] = "turnscan"
    tls: bool = False
    certificate: Path | None = None
    key: Path | None = None
    mdns: bool = True
    proxy: Annotated[str, AfterValidator(_addresses)] = ""
    upload_bytes: Annotated[int, Field(ge=1_000_000)] = UPLOAD_BYTES
    log_file: Path | None = None
    log_json: bool = False
    log_level: LogLevel = "info"

    @property
    def bench_spec(self) -> str:
        """What names the bench, for scans to remember."""
        return self.bench or "bench.toml"

    @property
    def scans(self) -> Path:
        return self.folder / "scans"

    @property
    def jobs(self) -> Path:
        return self.folder / "jobs"

    @property
    def calibrations(self) -> Path:
        return self.folder / "calibration_store"

    @property
    def log(self) -> Path:
        return self.log_file or self.folder / "logs" / "turnscan.log"

    @property
    def is_local(self) -> bool:
        """Whether only programs on this machine can reach the server."""
        return ipaddress.ip_address(self.host).is_loopback

    @property
    def is_encrypted(self) -> bool:
        return self.tls or self.certificate is not None


def read_settings(options: Mapping[str, Any], environment: Mapping[str, str] | None = None) -> Settings:
    """Settings from options, where those are not given from the environment, else as usual.

    Args:
        options: by the names of the fields; None for what is not given.
        environment: variables, by default those of this program; those of others are passed over.

    Raises:
        OptionError: naming the option or the variable that has no such value, or that does not exist.
    """
    environment = os.environ if environment is None else environment
    known = {field.name for field in fields(Settings)}
    named = {
        variable.removeprefix(PREFIX).lower(): (variable, text)
        for variable, text in environment.items()
        if variable.startswith(PREFIX) and variable != _OF_THE_BUILD
    }
    for field, (variable, _) in named.items():
        if field not in known:
            possible = ", ".join(PREFIX + name.upper() for name in sorted(known))
            raise OptionError(f"There is no setting {variable}.", f"There are: {possible}.")
    given: dict[str, Any] = {field: text for field, (_, text) in named.items() if text.strip()}
    chosen = {field: value for field, value in options.items() if value is not None}
    try:
        settings = Settings(**(given | chosen))
    except ValidationError as error:
        first = error.errors()[0]
        field = str(first["loc"][0])
        place = named[field][0] if field in given and field not in chosen else "--" + field.replace("_", "-")
        reason = first["msg"].removeprefix("Value error, ")
        raise OptionError(
            f"{place} cannot be {first['input']!r}: {reason}.", "Give another value."
        ) from error
    if (settings.certificate is None) != (settings.key is None):
        raise OptionError("A certificate and its key go together.", "Give both --certificate and --key.")
    return settings


def read_service_manager(environment: Mapping[str, str] | None = None) -> tuple[str, float]:
    """Where systemd wants to hear of the server, and within how many seconds; empty and 0 without it."""
    environment = os.environ if environment is None else environment
    limit_us = environment.get("WATCHDOG_USEC", "")
    is_ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    watchdog_s = 1e-6 * int(limit_us) if is_ours and limit_us.isdigit() else 0.0
    return environment.get("NOTIFY_SOCKET", ""), watchdog_s
