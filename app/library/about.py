"""`about.json`: what a person says of a scan. It lies in the scan's folder, so it travels with it."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from app.documents import Entry, Json, compose, read_document
from app.errors import LibraryError
from app.files import write_whole

ABOUT_FILE = "about.json"


def _is_a_moment(text: str) -> str:
    parse_moment(text)
    return text


class About(Entry):
    """The file; all that is not known is empty."""

    format: Literal["turnscan-about"] = "turnscan-about"
    version: Literal[1] = 1
    title: Annotated[str, Field(max_length=200)] = ""
    note: Annotated[str, Field(max_length=20_000)] = ""
    created: Annotated[str, AfterValidator(_is_a_moment)] | None = None


def read_about(folder: Path) -> About:
    """What is said of the scan in that folder.

    Raises:
        LibraryError: the file is damaged.
    """
    path = folder / ABOUT_FILE
    return read_document(path, About, _damaged) if path.is_file() else About()


def write_about(
    folder: Path, *, created: datetime, title: str | None = None, note: str | None = None
) -> None:
    """Change what is given and keep the rest; when it was created is said once and stays.

    Raises:
        LibraryError: the file that is there is damaged.
        OutputError: it cannot be written.
    """
    document: Json = read_about(folder).model_dump(mode="json")
    document["created"] = document["created"] or moment(created)
    document |= {key: value for key, value in (("title", title), ("note", note)) if value is not None}
    checked = compose(About, document, ABOUT_FILE, _damaged)
    text = json.dumps(checked.model_dump(mode="json"), indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(folder / ABOUT_FILE, text.encode() + b"\n")


def moment(when: datetime) -> str:
    """`2026-11-21T10:00:00Z`."""
    return when.astimezone(UTC).replace(microsecond=0).isoformat().replace("+00:00", "Z")


def parse_moment(text: str) -> datetime:
    """Back from `moment`. Raises ValueError."""
    when = datetime.fromisoformat(text)
    if when.tzinfo is None or not 1900 < when.year < 9999:
        raise ValueError("must be a time such as 2026-11-21T10:00:00Z")
    return when.astimezone(UTC)


def _damaged(where: str, problem: str) -> LibraryError:
    return LibraryError(
        f"{where}: {problem}", "Correct the file, or remove it: the title and the note go with it."
    )
