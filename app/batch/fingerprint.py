"""Whether a recording and its settings are still those that a result was made from."""

import hashlib
from pathlib import Path

from app.batch.order import BatchOrder
from app.errors import RecordingError
from app.files import reason
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE
from app.recording.reader import Recording


def fingerprint(folder: Path, order: BatchOrder) -> str:
    """Of the manifest, of the size and time of every picture, of the calibration's bytes, and of the order.

    Raises:
        RecordingError: there is none that could be used, or it went away meanwhile.
    """
    recording = Recording.open(folder)
    seen = hashlib.sha256(order.model_dump_json(exclude={"calibration", "fallback"}).encode())
    calibration = order.calibration_for(recording)
    try:
        for path in (recording.folder / MANIFEST_FILE, recording.folder / JOURNAL_FILE, calibration):
            if path is not None and path.is_file():
                seen.update(path.read_bytes())
        for entry in recording.entries:
            facts = (recording.folder / entry.file).stat()
            seen.update(f"{entry.file}:{facts.st_size}:{facts.st_mtime_ns};".encode())
    except OSError as error:
        raise RecordingError(str(folder), reason(error)) from error
    return seen.hexdigest()
