"""Under which addresses this machine can be reached, and a port to be reached at."""

import ipaddress
import socket
from dataclasses import dataclass

import psutil

from app.errors import OptionError
from app.files import reason

_TRIED_PORTS = 100
_BACKLOG = 128
_PATIENCE_MS = 60_000


@dataclass(frozen=True, slots=True)
class Reach:
    """How to reach a server.

    Attributes:
        scheme: `http` or `https`.
        hosts: names and addresses, the one to recommend first.
        port: at each.
    """

    scheme: str
    hosts: tuple[str, ...]
    port: int

    @property
    def addresses(self) -> list[str]:
        """As they are typed into a browser."""
        return [f"{self.scheme}://{bracketed(host)}:{self.port}" for host in self.hosts]


def bracketed(host: str) -> str:
    """As it stands in an address: those of version 6 in brackets."""
    return f"[{host}]" if ":" in host else host


def lan_addresses() -> list[str]:
    """Addresses of this machine in its networks, those of version 4 first; none of the loopback interface."""
    found: list[ipaddress.IPv4Address | ipaddress.IPv6Address] = []
    up = {name for name, stats in psutil.net_if_stats().items() if stats.isup}
    for name, entries in psutil.net_if_addrs().items():
        for entry in entries:
            if name in up and entry.family in (socket.AF_INET, socket.AF_INET6):
                address = ipaddress.ip_address(entry.address.partition("%")[0])
                if not (address.is_loopback or address.is_link_local or address.is_unspecified):
                    found.append(address)
    return [str(address) for address in sorted(set(found), key=lambda each: (each.version, int(each)))]


def reachable_at(host: str) -> list[str]:
    """The addresses in the network that a server bound to this one answers at."""
    address = ipaddress.ip_address(host)
    if not address.is_unspecified:
        return [] if address.is_loopback else [str(address)]
    # One that is bound to all of version 4 has none of version 6.
    return [each for each in lan_addresses() if address.version == 6 or ":" not in each]


def listening(host: str, port: int) -> socket.socket:
    """A socket that takes connections from now on.

    Raises:
        OptionError: the port is taken, not allowed, or this machine has no such address.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            # Whoever asks for all addresses means those of version 4, too.
            bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            # Those who connect have it from here: a client that reads nothing any more, or has vanished
            # without a word, is let go of by the system.
            bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _PATIENCE_MS)
        bound.bind((host, port))
        bound.listen(_BACKLOG)
    except OSError as error:
        bound.close()
        raise _refused(host, port, error) from error
    return bound


def _refused(host: str, port: int, error: OSError) -> OptionError:
    if isinstance(error, PermissionError):
        return OptionError(
            f"Port {port} may not be used by this user.", "Ports from 1024 may: try `--port 8000`."
        )
    other = _free_port(host, port + 1)
    if other is None:
        return OptionError(
            f"The address {host} cannot be served ({reason(error)}).",
            "Give `--host 0.0.0.0` to serve every interface of this machine.",
        )
    return OptionError(
        f"Port {port} is taken by another program, or by another Turnscan.",
        f"End that one, or try `--port {other}`, which is free.",
    )


def _free_port(host: str, first: int) -> int | None:
    """The next port that can be had at an address; None where none can."""
    for port in range(first, min(first + _TRIED_PORTS, 65536)):
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as trial:
            try:
                trial.bind((host, port))
            except OSError:
                continue
            return port
    return None
