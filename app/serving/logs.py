"""The log: one stream for everything, to a file and to the terminal. Nothing that fails here is felt.

What is logged goes into a queue, and a thread writes it: a slow or full disk costs lines, never time.
"""

import atexit
import logging
import queue
import re
from collections.abc import Callable
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path

from app.errors import OutputError
from app.files import make_folder, reason

_FILE_BYTES, _FILES = 10_000_000, 5
_MOST_WAITING = 20_000
_PLAIN = "%(asctime)s %(levelname)s %(name)s: %(message)s"
# Loggers that are not quiet, and whose every line is of no use.
_CHATTY = ("websockets", "asyncio", "PIL", "matplotlib", "numba", "trimesh", "uvicorn.access")
_SECRET = re.compile(
    r"""(?ix) \b(password|passwd|token|secret|key|cookie|authorization|session)
        (["']?\s*[=:]\s*["']?) (?:Bearer\s+)? [^\s"'&,;]+""",
)
_TOKEN = re.compile(r"turnscan_[A-Za-z0-9_-]{16,}")


def begin_logging(
    file: Path | None, *, level: str = "info", is_json: bool = False, to_terminal: bool = True
) -> Callable[[], None]:
    """Log into a file that is begun anew at 10 MB, five old ones are kept; and to standard error.

    Args:
        file: its folder is made where it is missing; None for no file.
        level: from which on lines are logged.
        is_json: whether each line is a JSON object.
        to_terminal: whether to standard error, too.

    Returns:
        What ends it; all that waits is written then.

    Raises:
        OutputError: the file cannot be written.
    """
    # The standard library would write tracebacks to the terminal otherwise.
    logging.raiseExceptions = False
    sinks: list[logging.Handler] = [logging.StreamHandler()] if to_terminal else []
    if file is not None:
        make_folder(file.parent)
        try:
            with file.open("a"):
                pass
        except OSError as error:
            raise OutputError(str(file), reason(error)) from error
        sinks.append(RotatingFileHandler(file, maxBytes=_FILE_BYTES, backupCount=_FILES, encoding="utf-8"))
    for sink in sinks:
        sink.setFormatter(_Discreet(_formatter(is_json)))
    waiting: queue.Queue[logging.LogRecord] = queue.Queue(_MOST_WAITING)
    door, listener = QueueHandler(waiting), QueueListener(waiting, *sinks)
    root = logging.getLogger()
    for old in tuple(root.handlers):
        root.removeHandler(old)
    root.addHandler(door)
    root.setLevel(level.upper())
    for name in _CHATTY:
        logging.getLogger(name).setLevel(max(logging.WARNING, root.level))
    listener.start()

    def end() -> None:
        atexit.unregister(end)
        root.removeHandler(door)
        listener.stop()
        for sink in sinks:
            sink.close()

    atexit.register(end)
    return end


def _formatter(is_json: bool) -> logging.Formatter:
    if not is_json:
        return logging.Formatter(_PLAIN)
    from pythonjsonlogger.json import JsonFormatter

    names = {"asctime": "time", "levelname": "level", "name": "logger"}
    return JsonFormatter(_PLAIN, rename_fields=names, json_ensure_ascii=False)


class _Discreet(logging.Formatter):
    """What looks like a password, a token or a key is not written, wherever it comes from."""

    def __init__(self, inner: logging.Formatter) -> None:
        super().__init__()
        self._inner = inner

    def format(self, record: logging.LogRecord) -> str:
        text = _SECRET.sub(r"\1\2...", self._inner.format(record))
        return _TOKEN.sub("turnscan_...", text)
