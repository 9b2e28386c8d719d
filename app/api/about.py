"""What the server is, and where it can be reached."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class About:
    """Facts of this server.

    Attributes:
        folder: that is served.
        is_local: whether only programs on this machine can reach it.
        hosts: names and addresses at which other machines reach it, the one to recommend first; they change
            while it runs.
    """

    folder: str
    is_local: bool = True
    hosts: Callable[[], Sequence[str]] = tuple
