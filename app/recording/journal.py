"""The journal of a recording that is being written: `recording.jsonl`, a header line and one line per frame.

Each line is on disk before the next frame is taken, so whatever ends the program, what was recorded can be
read. A last line that was cut short by the end is left out.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from app.documents import Entry, Json, parse_document
from app.errors import RecordingError
from app.files import reason
from app.recording.manifest import FrameEntry, Header, Manifest

MANIFEST_FILE = "recording.json"
JOURNAL_FILE = "recording.jsonl"


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a journal gives back.

    Attributes:
        manifest: every frame whose picture is there.
        left_out: files of frames whose picture never reached the disk.
    """

    manifest: Manifest
    left_out: tuple[str, ...]


def journal_line(entry: Entry) -> bytes:
    """One line of the journal, newline included."""
    return json.dumps(entry.as_json(), ensure_ascii=False, allow_nan=False).encode() + b"\n"


def read_journal(folder: Path) -> Recovery:
    """The manifest that the journal in that folder stands for.

    Raises:
        RecordingError: it is damaged other than at its end.
    """
    where = str(folder / JOURNAL_FILE)
    try:
        data = (folder / JOURNAL_FILE).read_bytes()
    except OSError as error:
        raise RecordingError(where, reason(error)) from error
    whole = [line for line in data[: data.rfind(b"\n") + 1].split(b"\n") if line]
    if not whole:
        raise RecordingError(where, "holds no frame yet")
    header = parse_document(whole[0], Header, f"{where}, line 1", RecordingError)
    frames: list[Json] = []
    left_out: list[str] = []
    for number, line in enumerate(whole[1:], start=2):
        entry = parse_document(line, FrameEntry, f"{where}, line {number}", RecordingError)
        if _has_bytes(folder / entry.file):
            frames.append(entry.as_json())
        else:
            left_out.append(entry.file)
    document = json.dumps({**header.as_json(), "frames": frames}).encode()
    return Recovery(parse_document(document, Manifest, where, RecordingError), tuple(left_out))


def _has_bytes(path: Path) -> bool:
    try:
        return path.stat().st_size > 0
    except OSError:
        return False
