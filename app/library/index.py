"""What was found in each folder, kept so that a list need not look at every picture again.

A folder is looked at anew when the files at its top, or its clouds, have changed. The file is a convenience:
without it, or when it is damaged, everything is looked at.
"""

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from app.errors import OutputError
from app.files import reason, write_whole
from app.library.item import CLOUDS_FOLDER, RECORDED, ScanItem, is_cloud, read_item, unreadable

INDEX_FILE = ".index.json"


@dataclass(frozen=True, slots=True)
class _Known:
    signature: str
    item: ScanItem


@dataclass(frozen=True, slots=True)
class _File:
    version: Literal[1] = 1
    known: Mapping[str, _Known] = field(default_factory=dict)


_FILE = TypeAdapter(_File)


class Index:
    """The scans in a folder.

    Attributes:
        folder: every folder in it that holds a recording or a cloud is a scan; links are not followed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def items(self) -> tuple[ScanItem, ...]:
        """All scans, by name. Takes time for each scan, whatever number of pictures it has.

        Raises:
            OSError: the folder cannot be read; one that is not there holds nothing.
        """
        before = self._load()
        after: dict[str, _Known] = {}
        items: list[ScanItem] = []
        for entry in self._folders():
            try:
                signature = _signature(entry.path)
                if not signature:
                    continue
                item = self._item(entry.name, signature, before)
                # What changed or went away while it was looked at must not be believed later.
                is_lasting = item.status != "running" and _signature(entry.path) == signature
            except FileNotFoundError:
                continue
            except OSError as error:
                items.append(unreadable(self.folder / entry.name, reason(error)))
                continue
            items.append(item)
            if is_lasting:
                after[entry.name] = _Known(signature, item)
        if after != before:
            with suppress(OutputError):
                write_whole(self.folder / INDEX_FILE, _FILE.dump_json(_File(known=after)), is_durable=False)
        return tuple(sorted(items, key=lambda item: item.name))

    def item(self, name: str) -> ScanItem:
        """One scan.

        Raises:
            FileNotFoundError: there is none in that folder.
        """
        signature = _signature(str(self.folder / name))
        if not signature:
            raise FileNotFoundError(name)
        return self._item(name, signature, self._load())

    def _item(self, name: str, signature: str, known: Mapping[str, _Known]) -> ScanItem:
        if name in known and known[name].signature == signature:
            return replace(known[name].item, folder=self.folder / name)
        return read_item(self.folder / name)

    def _folders(self) -> Iterator[os.DirEntry[str]]:
        with suppress(FileNotFoundError), os.scandir(self.folder) as entries:
            for entry in entries:
                if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False):
                    yield entry

    def _load(self) -> Mapping[str, _Known]:
        try:
            return _FILE.validate_json((self.folder / INDEX_FILE).read_bytes()).known
        except (OSError, ValidationError):
            return {}


def _signature(folder: str) -> str:
    """Changes with every file at the top and every cloud; empty where there is no scan."""
    facts = []
    is_scan = False
    for place in (folder, f"{folder}/{CLOUDS_FOLDER}"):
        try:
            with os.scandir(place) as entries:
                for entry in entries:
                    here = entry.stat(follow_symlinks=False)
                    facts.append((entry.name, here.st_mtime_ns, here.st_size, here.st_ino))
                    is_scan = is_scan or entry.name in RECORDED or is_cloud(entry.name)
        except (FileNotFoundError, NotADirectoryError):
            if place == folder:
                raise
    text = repr(sorted(facts)).encode("utf-8", "surrogateescape")
    return hashlib.blake2b(text, digest_size=16).hexdigest() if is_scan else ""
