"""Names of folders: what a person calls a scan becomes one that is safe on every system."""

import os
import re
import unicodedata
from pathlib import Path

from app.errors import LibraryError, ScanNotFound

_LONGEST = 60
_LONGEST_TITLE = 200
_LONGEST_NOTE = 20_000
# Windows knows these as devices, whatever their ending.
_DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{d}{n}" for d in ("com", "lpt") for n in range(10))})
# What the server calls its own things, where it has the scans.
_TAKEN = frozenset({"bin", "space", "upload"})


def slug(title: str) -> str:
    """Small letters, digits and single hyphens: `Grüne Tasse (2)` is `grune-tasse-2`."""
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
    name = re.sub(r"[^a-z0-9]+", "-", plain)[:_LONGEST].strip("-")
    return f"scan-{name}" if name in _DEVICES | _TAKEN else name or "scan"


def free_name(folder: Path, wanted: str, ending: str = "") -> str:
    """The name, or the first of `tasse-2`, `tasse-3` and so on that nothing in the folder has."""
    name, number = f"{wanted}{ending}", 1
    while os.path.lexists(folder / name):
        number += 1
        name = f"{wanted}-{number}{ending}"
    return name


def inside(folder: Path, name: str) -> Path:
    """The folder of that name in this one; the name may come from anywhere.

    Raises:
        ScanNotFound: there is none, or the name leads elsewhere.
    """
    is_plain = name.isprintable() and not name.startswith(".") and not set(name) & set('/\\:"')
    if name and is_plain and len(name.encode()) <= 255:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            return path
    raise ScanNotFound(f"There is no scan called {name[:60]!r} in {folder}.")


def checked_title(text: str) -> str:
    """One line of at most 200 characters, spaces evened.

    Raises:
        LibraryError: it is empty, too long or no text.
    """
    title = " ".join(text.split())
    if not 0 < len(title) <= _LONGEST_TITLE or not title.isprintable():
        raise LibraryError("The title cannot be used.", f"Give 1 to {_LONGEST_TITLE} letters.")
    return title


def checked_note(text: str) -> str:
    """Any text of at most 20 000 characters, several lines too.

    Raises:
        LibraryError: it is too long or no text.
    """
    note = text.strip()
    is_text = all(letter.isprintable() or letter in "\n\t" for letter in note)
    if len(note) > _LONGEST_NOTE or not is_text:
        raise LibraryError("The note cannot be used.", f"Give at most {_LONGEST_NOTE:,} letters.")
    return note
