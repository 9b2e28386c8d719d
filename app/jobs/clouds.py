"""Which cloud of a scan a job works on."""

from pathlib import Path

from app.errors import NotThere
from app.library.item import ScanItem


def cloud_of(item: ScanItem, name: str) -> Path:
    """The file of the cloud of that name, or of the newest one.

    Args:
        item: the scan.
        name: as `CloudItem.name`; empty for the newest.

    Raises:
        NotThere: there is none.
    """
    names = [cloud.name for cloud in item.clouds]
    if not names:
        raise NotThere(f"The scan {item.title!r} has no cloud.", "Reconstruct it first.")
    if name and name not in names:
        raise NotThere(
            f"The scan {item.title!r} has no cloud called {name[:60]!r}.", f"It has: {', '.join(names)}."
        )
    return item.folder / (name or names[-1])
