"""Where the results of each recording go: a folder of its own, named after it."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from app.batch.result import read_result
from app.errors import OutputError
from app.files import reason
from app.recording.journal import JOURNAL_FILE, MANIFEST_FILE


@dataclass(frozen=True, slots=True)
class Task:
    """A recording and the folder for what is made of it; both whole paths."""

    recording: Path
    folder: Path

    @property
    def name(self) -> str:
        """What people know it by; no other task has it."""
        return self.folder.name


def tasks_for(recordings: Sequence[Path], out: Path) -> list[Task]:
    """One for each recording, however often it is named; where it had results before, its folder is the same.

    The folder of the results is passed over: `archive/*` names it, too, where it lies among the recordings.
    Of several recordings with one name the second gets a folder such as `mug-2`. A folder that holds anything
    else is left alone.

    Raises:
        OutputError: the folder of the results cannot be looked at.
    """
    places = [place for place in dict.fromkeys(map(_folder, recordings)) if place != out.resolve()]
    try:
        taken = {place: name for place in places if (name := _earlier(place, out))}
        for place in places:
            if place not in taken:
                taken[place] = _free(place, out, taken.values())
    except OSError as error:
        raise OutputError(str(out), reason(error)) from error
    return [Task(place, out.resolve() / taken[place]) for place in places]


def _folder(path: Path) -> Path:
    """Of a recording; its manifest will do, too."""
    return (path.parent if path.name in (MANIFEST_FILE, JOURNAL_FILE) else path).resolve()


def _names(place: Path) -> Iterator[str]:
    name = place.name or "recording"
    return (name if number == 1 else f"{name}-{number}" for number in count(1))


def _earlier(place: Path, out: Path) -> str:
    """The folder that has results of this recording; empty where none has."""
    for name in _names(place):
        if not (out / name).exists():
            return ""
        result = read_result(out / name)
        if result is not None and result.recording == str(place):
            return name
    return ""


def _free(place: Path, out: Path, taken: Collection[str]) -> str:
    return next(
        name
        for name in _names(place)
        if name not in taken
        and (not (out / name).exists() or ((out / name).is_dir() and not any((out / name).iterdir())))
    )
