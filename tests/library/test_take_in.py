"""What is taken into a library, and what is turned away without a trace."""

import os
import stat
import struct
import zipfile
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import pytest
from small_library import HEADER, PICTURE, left_over, library_with, make_ply, make_recording, make_scan
from zips import bytes_of, parts, with_bytes, with_entry, zipped

from app.errors import ImportFailed, LibraryError, OutputError, ScanBusy
from app.library.library import Library
from app.library.limits import Limits
from app.library.take_in import take_in
from app.recording.reader import Recording
from app.recording.writer import RecordingWriter

Make = Callable[[Path, dict[str, bytes]], Path]


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(tmp_path / "scans")


def refused(library: Library, source: Path, limits: Limits | None = None) -> str:
    """Why it is turned away; nothing stays of it."""
    with pytest.raises(ImportFailed) as caught:
        take_in(library, source, limits=limits)
    assert library.scans() == ()
    assert left_over(library) == []
    message = caught.value.message
    assert ".work" not in message
    assert "\n" not in message
    assert caught.value.hint
    return message


def test_a_scan_s_folder_is_copied(library: Library, tmp_path: Path) -> None:
    source = make_scan(tmp_path / "My mug", status="paused")
    item = take_in(library, source)
    assert (item.name, item.title, item.status, item.pictures) == ("my-mug", "My mug", "paused", 3)
    assert len(Recording.open(item.folder).entries) == 3
    assert source.exists()
    assert take_in(library, source).name == "my-mug-2"


def test_an_exported_scan_comes_back_with_title_note_and_date(library: Library, tmp_path: Path) -> None:
    there = library_with(tmp_path / "there", "mug")
    os.utime(tmp_path / "there" / "mug" / "frames" / "000000.png", (10**9, 10**9))
    there.rename("mug", "Grüne Tasse")
    before = there.note("mug", "a note")
    path = tmp_path / "x.zip"
    path.write_bytes(b"".join(there.export("mug")))
    item = take_in(library, path)
    assert (item.title, item.note, item.created) == (before.title, before.note, before.created)
    assert (item.name, item.pictures, item.status) == ("grune-tasse", 3, "finished")
    assert take_in(library, path, "Mine").title == "Mine"


def test_a_foreign_recording_keeps_the_time_of_its_pictures(library: Library, tmp_path: Path) -> None:
    source = make_recording(tmp_path / "r")
    os.utime(source / "frames" / "000001.png", (10**9, 10**9))
    item = take_in(library, source)
    assert item.status == "recording"
    assert item.created.timestamp() == 10**9


def test_a_ply_becomes_a_scan_without_pictures_but_with_a_thumbnail(library: Library, tmp_path: Path) -> None:
    item = take_in(library, make_ply(tmp_path / "Ball 1.ply", 500))
    assert (item.status, item.points, item.title) == ("cloud", 500, "Ball 1")
    assert item.thumbnail is not None
    assert item.thumbnail.read_bytes().startswith(b"\x89PNG")


def test_clouds_of_a_zip_get_their_thumbnails(library: Library, tmp_path: Path) -> None:
    files = parts(tmp_path / "s") | {"clouds/a.ply": make_ply(tmp_path / "a.ply").read_bytes()}
    assert take_in(library, zipped(tmp_path / "z.zip", files)).thumbnail is not None


@pytest.mark.parametrize("prefix", ["", "mug/", "a/b/"])
@pytest.mark.parametrize("kind", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_zip_holds_a_scan_at_its_top_or_in_its_one_folder(
    prefix: str, kind: int, library: Library, tmp_path: Path
) -> None:
    files = {prefix + name: data for name, data in parts(tmp_path / "s").items()}
    files |= {"__MACOSX/x": b"", f"{prefix}.DS_Store": b""}
    item = take_in(library, zipped(tmp_path / "mug.zip", files, kind), name="Green mug.zip")
    assert (item.name, item.pictures) == ("green-mug", 3)
    assert not list(item.folder.rglob(".DS_Store"))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("../evil", "leads out"), ("a/../../evil", "leads out"), ("/etc/evil", "absolute"),
        ("C:/evil", "absolute"), ("C:evil", "absolute"), ("..\\evil", "another system"),
        ("\\\\host\\evil", "another system"), ("a//evil", "cannot be used"), ("./evil", "cannot be used"),
        ("a\x01b", "cannot be used"), ("x" * 300, "cannot be used"), ("a/" * 20 + "evil", "deep"),
        ("evil:stream", "cannot be used"),
    ],
)  # fmt: skip
def test_names_that_lead_elsewhere_are_turned_away(
    name: str, told: str, library: Library, tmp_path: Path
) -> None:
    files = parts(tmp_path / "s") | {name: b"evil"}
    # The standard library makes slashes of backslashes, which an attacker would not.
    path = zipped(tmp_path / "z.zip", {key.replace("\\", "|"): data for key, data in files.items()})
    if "\\" in name:
        with_bytes(path, name.replace("\\", "|").encode(), name.encode())
    assert told in refused(library, path)
    assert not list(tmp_path.parent.glob("evil"))
    assert not Path("evil").exists()


def test_links_and_devices_are_turned_away(library: Library, tmp_path: Path) -> None:
    files = parts(tmp_path / "s")
    for kind in (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR):
        info = zipfile.ZipInfo("frames/link.png")
        info.external_attr = (kind | 0o777) << 16
        path = with_entry(zipped(tmp_path / "z.zip", files), info, b"/etc/passwd")
        assert "is no file" in refused(library, path)


def test_a_folder_with_a_link_is_turned_away(library: Library, tmp_path: Path) -> None:
    source = make_scan(tmp_path / "s")
    (source / "frames" / "000000.png").unlink()
    (source / "frames" / "000000.png").symlink_to("/etc/passwd")
    assert "is no file" in refused(library, source)


def test_too_many_or_too_much_is_turned_away(library: Library, tmp_path: Path) -> None:
    path = zipped(tmp_path / "z.zip", parts(tmp_path / "s"))
    assert "more than 4 files" in refused(library, path, Limits(entries=4))
    assert "more than 500 bytes" in refused(library, path, Limits(total_bytes=500))
    assert "more than 4 files" in refused(library, tmp_path / "s", Limits(entries=4))
    assert "more than 500 bytes" in refused(library, tmp_path / "s", Limits(total_bytes=500))
    cloud = make_ply(tmp_path / "c.ply")
    assert "larger than 500 bytes" in refused(library, cloud, Limits(cloud_bytes=500))


def test_a_bomb_is_turned_away(library: Library, tmp_path: Path) -> None:
    files = parts(tmp_path / "s") | {"bomb": bytes(10 << 20)}
    path = zipped(tmp_path / "z.zip", files, zipfile.ZIP_DEFLATED)
    assert "50 times its size" in refused(library, path)


def test_a_table_of_contents_too_large_for_the_memory_is_not_read(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = zipped(tmp_path / "z.zip", {f"{number:0200d}": b"" for number in range(100)})
    monkeypatch.setattr(zipfile, "ZipFile", pytest.fail)
    assert "more than 50 files" in refused(library, path, Limits(entries=50))


def test_nothing_is_unpacked_where_there_is_no_room(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10**12, 0, 64_000_000))
    for source in (
        zipped(tmp_path / "z.zip", parts(tmp_path / "s")), tmp_path / "s", make_ply(tmp_path / "c.ply"),
    ):  # fmt: skip
        with pytest.raises(OutputError, match="no room"):
            take_in(library, source)
        assert library.scans() == ()
        assert left_over(library) == []


def test_a_disk_that_is_full_in_the_middle_leaves_nothing(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = zipped(tmp_path / "z.zip", parts(tmp_path / "s"))

    def full(done: int, total: int) -> None:
        if done > total / 2:
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="no space left"):
        take_in(library, path, progress=full)
    assert library.scans() == ()
    assert left_over(library) == []


def without_manifest(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, {name: data for name, data in files.items() if not name.endswith(".json")})


def without_a_picture(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, {name: data for name, data in files.items() if name != "frames/000001.png"})


def with_a_broken_manifest(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"recording.json": b"{"})


def with_a_broken_scan_file(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"scan.json": b'{"status": "finished"}'})


def with_a_broken_title(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"about.json": b'{"title": 3}'})


def with_a_broken_cloud(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"clouds/a.ply": b"ply\n"})


def with_two_scans(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, {f"{top}/{name}": data for top in "ab" for name, data in files.items()})


def with_a_damaged_picture(path: Path, files: dict[str, bytes]) -> Path:
    return with_bytes(zipped(path, files), PICTURE, bytes(len(PICTURE)))


def cut_short(path: Path, files: dict[str, bytes]) -> Path:
    path.write_bytes(bytes_of(files)[:-300])
    return path


def that_is_none(path: Path, files: dict[str, bytes]) -> Path:
    path.write_bytes(b"PK but no zip file at all")
    return path


def of_nothing(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, {})


def encrypted(path: Path, files: dict[str, bytes]) -> Path:
    zipped(path, {"recording.json": b"{}"})
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(data)
    return path


def unusually_compressed(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files, zipfile.ZIP_LZMA)


def with_large_and_small_letters(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"FRAMES/000000.PNG": b""})


def with_a_file_that_is_a_folder(path: Path, files: dict[str, bytes]) -> Path:
    return zipped(path, files | {"frames": b""})


def with_a_lie_about_its_contents(path: Path, files: dict[str, bytes]) -> Path:
    zipped(path, files)
    data = bytearray(path.read_bytes())
    struct.pack_into("<L", data, len(data) - 22 + 16, 2**31)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (without_manifest, "holds no recording"), (without_a_picture, "frames/000001.png is missing"),
        (with_a_broken_manifest, "recording.json"), (with_a_broken_scan_file, "scan.json"),
        (with_a_broken_title, "about.json: title"), (with_a_broken_cloud, "clouds/a.ply"),
        (with_two_scans, "2 scans"), (with_a_damaged_picture, "is damaged"), (cut_short, "damaged"),
        (that_is_none, "no zip file"), (of_nothing, "holds no recording"), (encrypted, "encrypted"),
        (unusually_compressed, "unusual"), (with_large_and_small_letters, "twice"),
        (with_a_file_that_is_a_folder, "folder, too"), (with_a_lie_about_its_contents, "damaged"),
    ],
)  # fmt: skip
def test_a_zip_is_turned_away_in_one_sentence(
    make: Make, told: str, library: Library, tmp_path: Path
) -> None:
    message = refused(library, make(tmp_path / "up.zip", parts(tmp_path / "s")))
    assert message.startswith("up.zip: ")
    assert told in message


def test_what_is_no_scan_is_turned_away(library: Library, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("hello")
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nend_header\n")
    (tmp_path / "papers").mkdir()
    assert "neither" in refused(library, tmp_path / "text")
    assert "broken.ply" in refused(library, tmp_path / "broken.ply")
    assert "no recording" in refused(library, tmp_path / "papers")
    assert "no such file" in refused(library, tmp_path / "missing")


def test_a_scan_that_is_being_taken_waits(library: Library, tmp_path: Path) -> None:
    with RecordingWriter.create(tmp_path / "r", HEADER), pytest.raises(ScanBusy):
        take_in(library, tmp_path / "r")
    assert library.scans() == ()


def test_a_title_that_cannot_be_used_is_refused_before_the_copy(library: Library, tmp_path: Path) -> None:
    with pytest.raises(LibraryError, match="title"):
        take_in(library, make_scan(tmp_path / "s"), "x" * 201)


def test_progress_is_told_in_bytes(library: Library, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    path = zipped(tmp_path / "z.zip", parts(tmp_path / "s"))
    take_in(library, path, progress=lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1][0] == told[-1][1] > 0
