"""Runs every change of a library again and again, each time killed one step later, and says what was left.

A program of its own, because it forks: `dying.py FOLDER` prints one JSON object, for each change a list of
states, one for each death. The last is that of a change that came to its end.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from small_library import make_scan

from app.library.library import Library
from app.library.take_in import take_in
from app.library.work import sweep
from app.recording.reader import Recording

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_STEPS = frozenset(
    {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate", "os.utime", "os.chmod", "fcntl.flock"}
)
_KILLED = 9


def changes(source: Path, zip_file: Path) -> dict[str, Callable[[Library], object]]:
    """Every change of a library that holds `mug` and, in the bin, `cup`."""
    return {
        "rename": lambda library: library.rename("mug", "Another"),
        "note": lambda library: library.note("mug", "A note"),
        "delete": lambda library: library.delete("mug"),
        "restore": lambda library: library.restore("cup"),
        "empty": lambda library: library.empty(),
        "import-folder": lambda library: take_in(library, source),
        "import-zip": lambda library: take_in(library, zip_file),
    }


def die_at(step: int) -> None:
    """End this program, without a word or a clean-up, before its n-th change of the file system."""
    left = step

    def count(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal left
        flags = arguments[2] if event == "open" and len(arguments) > 2 else 0
        if event in _STEPS or (isinstance(flags, int) and flags & _WRITING):
            left -= 1
            if left == 0:
                os._exit(_KILLED)

    sys.addaudithook(count)


def state_of(library: Library) -> list[str]:
    """What a person would find: scans and bin, each with title, note and pictures that are truly there."""
    found = [f"{i.name}|{i.title}|{i.note}|{len(Recording.open(i.folder).entries)}" for i in library.scans()]
    found += [f"bin:{b.name}|{len(Recording.open(b.scan.folder).entries)}" for b in library.bin()]
    sweep(library.folder)
    found += [f"left over:{path.name}" for path in (library.folder / ".work").glob("*")]
    return sorted(found)


def deaths(folder: Path, change: Callable[[Library], object]) -> list[list[str]]:
    """What is left after each death, and after none."""
    states = []
    step, code = 0, _KILLED
    while code == _KILLED:
        step += 1
        library = Library(folder)
        make_scan(folder / "cup")
        library.delete("cup")
        make_scan(folder / "mug")
        child = os.fork()
        if child == 0:
            die_at(step)
            change(library)
            os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        states.append(state_of(library))
        shutil.rmtree(folder)
    assert code == 0, code
    return states


def main(folder: Path) -> None:
    # A killed program leaves the disk alone, so nobody need wait for it.
    vars(os).update(sync=lambda: None, fsync=lambda handle: None)
    source = make_scan(folder / "pot")
    zip_file = folder / "jar.zip"
    make_scan(folder / "shelf" / "jar")
    zip_file.write_bytes(b"".join(Library(folder / "shelf").export("jar")))
    result = {name: deaths(folder / name, change) for name, change in changes(source, zip_file).items()}
    sys.stdout.write(json.dumps(result))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
