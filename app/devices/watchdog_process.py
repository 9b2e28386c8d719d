"""The process that puts the lasers out when the program cannot: it dies, hangs or is killed.

Started as `python -m app.devices.watchdog_process`, with a pipe from the program as its standard input. It
reads lines of JSON: `{"guard": {...}}` names what to do (see `Farewell`), `{}` is a sign of life, `{"leave":
true}` the end. A pipe that ends without that means that the program is gone; silence, that it hangs.

While it talks to the board of a program that is gone, it holds a shared lock on the port. A program that
opens the port locks it for itself: whoever comes second waits (the program, see `SerialLink`) or steps aside
(the watchdog: a board that has just been connected has its lasers off).

It imports hardly more than pyserial, so that it is ready at once and small.
"""

import contextlib
import json
import os
import queue
import signal
import sys
import threading
import time
from typing import Any

import serial

from app.devices.port_lock import shared

# Several signs of life: on a busy machine some are late.
SILENCE_S = 2.0
_PATIENCE_S = 5.0
_TRY_AGAIN_S = 0.05


def main() -> None:
    """Watch the pipe until the program leaves, in whatever way."""
    # Ctrl-C reaches the whole group of processes; this one must outlive the program.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(arrived,), daemon=True).start()
    guarded: dict[str, Any] | None = None
    has_played = False
    pending = b""
    while True:
        try:
            data = arrived.get(timeout=SILENCE_S)
        except queue.Empty:
            if guarded is not None and not has_played:
                play(guarded)
                has_played = True
            continue
        if not data:
            if guarded is not None:
                play(guarded, steps_aside=True)
            return
        has_played = False
        *lines, pending = (pending + data).split(b"\n")
        for line in lines:
            message = json.loads(line)
            if message.get("leave"):
                return
            if "guard" in message:
                guarded = message["guard"]


def play(farewell: dict[str, Any], *, steps_aside: bool = False) -> bool:
    """Send a board its farewell; whether it could be reached.

    Args:
        farewell: `port`, `baud`, `stop_bits` and `words`: pairs of bytes (as latin-1 text) and seconds.
        steps_aside: leave a board alone that another program has connected.
    """
    ends_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < ends_s:
        try:
            with (
                shared(farewell["port"]) if steps_aside else contextlib.nullcontext(),
                serial.serial_for_url(
                    farewell["port"], farewell["baud"], stopbits=farewell["stop_bits"], write_timeout=1.0
                ) as port,
            ):
                for word, wait_s in farewell["words"]:
                    port.write(word.encode("latin-1"))
                    port.flush()
                    time.sleep(wait_s)
                return True
        except (serial.SerialException, OSError, ValueError):
            time.sleep(_TRY_AGAIN_S)
    return False


def _read(arrived: "queue.SimpleQueue[bytes]") -> None:
    """Everything from the pipe; nothing at its end."""
    data = b"-"
    while data:
        data = os.read(sys.stdin.fileno(), 65536)
        arrived.put(data)


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        main()
