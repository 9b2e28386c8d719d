"""What every command says goes to standard error, so that results can go to standard output."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from app.errors import OutputError

console = Console(stderr=True, highlight=False)


class ShowProgress(Protocol):
    """Told the stage, how much of it is done, where known of how much, and what else changes."""

    def __call__(self, stage: str, done: int, total: int | None, note: str = "") -> None: ...


@contextmanager
def progress_bar() -> Iterator[ShowProgress]:
    """A bar for each stage, with the time that is left."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console) as progress:
        tasks = {}

        def show(stage: str, done: int, total: int | None, note: str = "") -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total, note="")
            progress.update(tasks[stage], completed=done, total=total, note=note)

        yield show
        for task in tasks.values():
            if progress.tasks[task].total is None:
                progress.update(task, total=progress.tasks[task].completed)


def say(lines: Iterable[str]) -> None:
    """Plain lines."""
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)


def warn(texts: Iterable[str], *, is_doubt: bool = False) -> None:
    """Sentences that a person should read."""
    style = "bold red" if is_doubt else "yellow"
    word = "Do not trust this result:" if is_doubt else "Note:"
    for text in texts:
        console.print(word, style=style, end=" ", soft_wrap=True)
        console.print(text, markup=False, soft_wrap=True)


def check_output(path: Path, taken: Sequence[Path] = ()) -> None:
    """Complain before the work rather than after it.

    Args:
        path: where a result goes.
        taken: files that are read, or written with another result.

    Raises:
        OutputError: the folder of a result is not there or cannot be written, or the place is taken.
    """
    if os.path.realpath(path) in map(os.path.realpath, taken):
        raise OutputError(str(path), "the same command reads or writes it already", "Name another file.")
    folder = path.parent
    if not folder.is_dir():
        raise OutputError(str(path), f"the folder {folder} is not there", "Make it, or name another place.")
    if path.is_dir():
        raise OutputError(str(path), "is a folder", "Name a file.")
    if not os.access(folder, os.W_OK):
        raise OutputError(str(path), f"the folder {folder} cannot be written", "Name another place.")
