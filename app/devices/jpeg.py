"""JPEG as cameras send it, made into files that every program reads.

Motion JPEG leaves out the Huffman tables that everybody knows (AVI MJPEG DIB, 1996), and drivers hand over
buffers with something left behind the picture.
"""

import re
from functools import cache

import numpy as np

from app.recording.picture import encode

_START, _END = b"\xff\xd8", 0xD9
_TABLES, _SCAN = 0xC4, 0xDA
_BARE = frozenset({0x01, *range(0xD0, 0xD8)})
# Within a scan 0xFF is followed by 0 or by a restart marker; everything else ends it.
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def whole_jpeg(data: bytes) -> bytes:
    """The picture alone, with its tables.

    Raises:
        ValueError: it is no JPEG or has no end; the problem as a predicate.
    """
    if not data.startswith(_START):
        raise ValueError("is not JPEG")
    has_tables, first_scan, at = False, 0, 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            raise ValueError("is damaged")
        marker = data[at + 1]
        if marker == _END:
            break
        if marker == 0xFF:
            at += 1
            continue
        if marker in _BARE:
            at += 2
            continue
        has_tables = has_tables or marker == _TABLES
        if marker == _SCAN:
            first_scan = first_scan or at
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == _SCAN:
            found = _AFTER_SCAN.search(data, at)
            if found is None:
                raise ValueError("is truncated")
            at = found.start()
    if not first_scan or data[at : at + 2] != b"\xff\xd9":
        raise ValueError("is truncated")
    if not has_tables:
        return data[:first_scan] + _standard_tables() + data[first_scan : at + 2]
    return data if at + 2 == len(data) else data[: at + 2]


@cache
def _standard_tables() -> bytes:
    """The tables of ITU-T T.81, annex K.3, as an encoder writes them that does not compute its own."""
    data, at, tables = encode(np.zeros((8, 8, 3), np.uint8), "jpeg"), 2, b""
    while data[at + 1] != _SCAN:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == _TABLES:
            tables += data[at:end]
        at = end
    return tables
