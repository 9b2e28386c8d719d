"""Lasers are not left burning because a board does not answer."""

import contextlib
from collections.abc import Iterator

from app.devices.serial_link import SerialLink
from app.errors import DeviceError, DeviceTimeout, MoveStopped

# How long a board that stands may take to answer a laser command; it may have heard it.
LASER_ANSWER_S = 0.5


@contextlib.contextmanager
def dark_unless_answered(link: SerialLink, words_off: bytes) -> Iterator[None]:
    """A laser whose command is not answered is put out with words that nobody waits for.

    The answer to these may still come, so that the board is out of step afterwards.
    """
    try:
        yield
    except (DeviceTimeout, MoveStopped):
        with contextlib.suppress(DeviceError):
            link.write(words_off)
        raise
