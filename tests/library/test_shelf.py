"""Scans in a folder: what is there, what it is called, what was thrown away."""

import os
import shutil
import threading
from pathlib import Path

import pytest
from small_library import (
    HEADER,
    PICTURE,
    add_pictures,
    library_with,
    make_ply,
    make_recording,
    make_scan,
    write_scan_file,
)

from app.errors import LibraryError, ScanBusy, ScanNotFound
from app.library import library as library_module
from app.library.library import Library
from app.library.names import slug
from app.library.work import changing
from app.recording.reader import Recording
from app.recording.writer import RecordingWriter


def names(library: Library) -> set[str]:
    return {item.name for item in library.scans()}


def test_a_library_that_is_not_there_is_empty(tmp_path: Path) -> None:
    library = Library(tmp_path / "scans")
    assert library.scans() == ()
    assert library.bin() == ()
    assert library.space().free_bytes > 0
    assert not (tmp_path / "scans").exists()


def test_every_folder_with_a_recording_or_a_cloud_is_a_scan(tmp_path: Path) -> None:
    make_scan(tmp_path / "finished", pictures=4)
    make_scan(tmp_path / "paused", status="paused")
    make_recording(tmp_path / "foreign")
    make_ply(tmp_path / "cloud" / "clouds" / "a.ply")
    (tmp_path / "empty").mkdir()
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "letter.txt").touch()
    items = {item.name: item for item in Library(tmp_path).scans()}
    assert {name: item.status for name, item in items.items()} == {
        "finished": "finished", "paused": "paused", "foreign": "recording", "cloud": "cloud",
    }  # fmt: skip
    assert items["finished"].pictures == 4
    assert items["cloud"].points == 50


def test_an_item_says_what_lies_in_its_folder(tmp_path: Path) -> None:
    folder = make_scan(tmp_path / "mug")
    make_ply(folder / "clouds" / "a.ply", 70)
    (folder / "clouds" / "a.png").touch()
    (folder / "calibration.json").write_text('{"created": "2026-01-02T03:04:05Z", "expected_error_mm": 0.05}')
    item = Library(tmp_path).scan("mug")
    assert item.title == "mug"
    assert [(cloud.name, cloud.points) for cloud in item.clouds] == [("clouds/a.ply", 70)]
    assert item.thumbnail == folder / "clouds" / "a.png"
    assert item.size_bytes == sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert item.calibration is not None
    assert item.calibration.created.isoformat() == "2026-01-02T03:04:05+00:00"
    assert item.calibration.expected_error_mm == 0.05


def test_a_scan_that_is_written_runs_and_one_whose_program_was_killed_is_paused(tmp_path: Path) -> None:
    library = Library(tmp_path)
    writer = RecordingWriter.create(library.reserve("Mug"), HEADER)
    write_scan_file(tmp_path / "mug", "running")
    add_pictures(writer, 2)
    assert library.scan("mug").status == "running"
    assert library.scans()[0].pictures == 2
    add_pictures(writer, 1)
    assert library.scans()[0].pictures == 3
    # The lock goes with its program.
    writer.suspend()
    item = library.scans()[0]
    assert (item.status, item.pictures) == ("paused", 3)
    assert item.reason


def test_a_scan_that_runs_is_neither_deleted_nor_exported(tmp_path: Path) -> None:
    library = Library(tmp_path)
    with RecordingWriter.create(library.reserve("mug"), HEADER) as writer:
        add_pictures(writer, 1)
        with pytest.raises(ScanBusy, match="mug"):
            library.delete("mug")
        with pytest.raises(ScanBusy, match="mug"):
            library.export("mug")
        assert names(library) == {"mug"}
    library.delete("mug")
    assert names(library) == set()


def test_a_damaged_folder_spoils_no_list(tmp_path: Path) -> None:
    library = library_with(tmp_path, "good", "bad", "worse", "titleless")
    (tmp_path / "bad" / "recording.json").write_text("{")
    (tmp_path / "worse" / "scan.json").write_text("[]")
    (tmp_path / "titleless" / "about.json").write_bytes(b"\xff")
    found = {item.name: item for item in library.scans()}
    assert {item.status for name, item in found.items() if name != "good"} == {"damaged"}
    assert found["good"].status == "finished"
    assert "recording.json" in found["bad"].reason
    assert "scan.json" in found["worse"].reason
    assert "about.json" in found["titleless"].reason


def test_a_list_looks_at_pictures_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = library_with(tmp_path, "a", "b")
    first = library.scans()
    looked: list[str] = []
    scandir = os.scandir

    def noted(path: str) -> "os._ScandirIterator[str]":
        looked.append(str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", noted)
    assert Library(tmp_path).scans() == first
    assert looked
    assert not [path for path in looked if path.endswith("frames")]
    library.rename("a", "Another title")
    library.scans()
    assert [path for path in looked if path.endswith("frames")] == [str(tmp_path / "a" / "frames")] * 2


def test_a_list_sees_every_change_at_once(tmp_path: Path) -> None:
    library = library_with(tmp_path, "a")
    for title in ("one", "two", "six", "ten"):
        library.rename("a", title)
        assert library.scans()[0].title == title
    make_ply(tmp_path / "a" / "clouds" / "x.ply", 10)
    assert library.scans()[0].points == 10
    make_scan(tmp_path / "b")
    assert names(library) == {"a", "b"}
    shutil.rmtree(tmp_path / "a")
    assert names(library) == {"b"}


def test_a_scan_that_goes_away_while_it_is_looked_at_is_seen_whole_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = library_with(tmp_path, "mug")
    scandir = os.scandir

    def moved(path: str) -> "os._ScandirIterator[str]":
        if str(path).endswith("frames"):
            monkeypatch.undo()
            library.delete("mug")
        return scandir(path)

    monkeypatch.setattr(os, "scandir", moved)
    assert library.scans() == ()
    item = library.restore("mug")
    assert (item.pictures, item.status) == (3, "finished")
    assert library.scans() == (item,)
    assert item.size_bytes > 3 * len(PICTURE)


@pytest.mark.parametrize("damage", [b"", b"{", b'{"version": 2}', b'{"version": 1, "known": {"a": 3}}'])
def test_a_damaged_index_costs_time_and_nothing_else(damage: bytes, tmp_path: Path) -> None:
    library = library_with(tmp_path, "a")
    first = library.scans()
    (tmp_path / ".index.json").write_bytes(damage)
    assert library.scans() == first


def test_a_library_can_be_copied(tmp_path: Path) -> None:
    library = library_with(tmp_path / "here", "a")
    library.rename("a", "Mug")
    library.scans()
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    item = Library(tmp_path / "there").scans()[0]
    assert item.title == "Mug"
    assert item.folder == tmp_path / "there" / "a"


def test_title_and_note_lie_in_the_folder_of_the_scan(tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug")
    created = library.scan("mug").created
    library.note("mug", "  two\nlines ")
    item = library.rename("mug", " Grüne   Tasse ")
    assert (item.name, item.title, item.note) == ("mug", "Grüne Tasse", "two\nlines")
    shutil.copytree(tmp_path / "mug", tmp_path / "other" / "x")
    copied = Library(tmp_path / "other").scan("x")
    assert (copied.title, copied.note, copied.created) == ("Grüne Tasse", "two\nlines", created)
    assert library.note("mug", "").note == ""


@pytest.mark.parametrize("title", ["", "  ", "x" * 201, "a\x00b", "a\x1bb", "\ud800"])
def test_a_title_that_is_no_line_of_text_is_refused(title: str, tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug")
    with pytest.raises(LibraryError, match="title"):
        library.rename("mug", title)
    assert library.scan("mug").title == "mug"


@pytest.mark.parametrize("note", ["x" * 20_001, "a\x00", "\udfff"])
def test_a_note_that_is_no_text_is_refused(note: str, tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="note"):
        library_with(tmp_path, "mug").note("mug", note)


@pytest.mark.parametrize(
    ("title", "name"),
    [
        ("Grüne Tasse (2)", "grune-tasse-2"), ("../../etc/passwd", "etc-passwd"), ("日本", "scan"),
        ("CON", "scan-con"), ("..", "scan"), ("x" * 300, "x" * 60), (".hidden", "hidden"),
    ],
)  # fmt: skip
def test_a_folder_gets_a_safe_name(title: str, name: str) -> None:
    assert slug(title) == name


def test_reserved_folders_are_new_and_empty(tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug")
    assert library.reserve("Mug").name == "mug-2"
    assert library.reserve("mug").name == "mug-3"
    assert list((tmp_path / "mug-3").iterdir()) == []
    assert names(library) == {"mug"}


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../mug", "a/b", "mug/", "/mug", ".bin", ".work", "\\", "C:", "\x00", "no"]
)
def test_no_name_leads_elsewhere(name: str, tmp_path: Path) -> None:
    library = library_with(tmp_path / "scans", "mug", "gone")
    make_scan(tmp_path / "mug")
    library.delete("gone")
    for call in (library.scan, library.delete, library.export, lambda n: library.rename(n, "x")):
        with pytest.raises(ScanNotFound):
            call(name)
    with pytest.raises(ScanNotFound):
        library.restore(name)
    assert (tmp_path / "mug" / "scan.json").exists()


def test_a_link_is_no_scan(tmp_path: Path) -> None:
    make_scan(tmp_path / "elsewhere")
    library = library_with(tmp_path / "scans", "mug")
    (tmp_path / "scans" / "link").symlink_to(tmp_path / "elsewhere")
    assert names(library) == {"mug"}
    with pytest.raises(ScanNotFound):
        library.delete("link")


def test_what_is_deleted_lies_in_the_bin_until_it_is_restored(tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug", "cup")
    library.note("mug", "kept")
    before = library.scan("mug")
    thrown = library.delete("mug")
    assert names(library) == {"cup"}
    assert library.bin() == (thrown,)
    assert (thrown.name, thrown.scan.title, thrown.scan.note) == ("mug", "mug", "kept")
    assert library.space().bin_bytes == before.size_bytes
    assert library.restore(thrown.key) == before
    assert library.bin() == ()


def test_a_restored_scan_takes_no_other_s_place(tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug")
    library.delete("mug")
    make_scan(tmp_path / "mug", pictures=9)
    assert library.restore("mug").name == "mug-2"
    assert library.scan("mug").pictures == 9


def test_emptying_erases_what_was_named_or_all(tmp_path: Path) -> None:
    library = library_with(tmp_path, "a", "b", "c", "d")
    keys = {name: library.delete(name).key for name in ("a", "b", "c")}
    size = library.scan("d").size_bytes
    with pytest.raises(ScanNotFound):
        library.empty([keys["a"], "nothing"])
    assert len(library.bin()) == 3
    assert library.empty([keys["a"]]) == size
    assert {thrown.name for thrown in library.bin()} == {"b", "c"}
    assert library.empty() == 2 * size
    assert library.bin() == ()
    assert names(library) == {"d"}
    assert [path.name for path in (tmp_path / ".bin").iterdir() if path.is_dir()] == []


def test_a_recording_survives_bin_and_return(tmp_path: Path) -> None:
    library = library_with(tmp_path, "mug")
    library.delete("mug")
    assert len(Recording.open(library.restore("mug").folder).entries) == 3


def test_one_program_at_a_time_changes_a_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = library_with(tmp_path, "mug")
    monkeypatch.setattr("app.library.work._PATIENCE_S", 0.0)
    with changing(tmp_path):
        with pytest.raises(LibraryError, match="Another program"):
            library.delete("mug")
        # Looking needs no leave.
        assert names(library) == {"mug"}
    library.delete("mug")


def test_the_room_on_the_disk_is_that_of_the_library(tmp_path: Path) -> None:
    free = library_module.free_bytes(tmp_path / "not" / "yet" / "there")
    assert free == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.05)


def test_many_at_once_lose_nothing(tmp_path: Path) -> None:
    library = library_with(tmp_path, *"abcd")
    failed: list[Exception] = []

    def busy(name: str, other: str) -> None:
        mine = Library(tmp_path)
        try:
            for number in range(8):
                mine.rename(other, f"{name} {number}")
                mine.restore(mine.delete(name).key)
                mine.scans()
        except ScanNotFound:
            # The other one has just thrown it away.
            busy(name, name)
        except Exception as error:  # noqa: BLE001 (a thread must not swallow it)
            failed.append(error)

    threads = [threading.Thread(target=busy, args=pair) for pair in ("ab", "ba", "cd", "dc")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    assert names(library) | {thrown.name for thrown in library.bin()} == set("abcd")
    assert all(len(Recording.open(item.folder).entries) == 3 for item in library.scans())
