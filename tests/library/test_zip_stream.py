"""A scan as a zip file, made while it is sent."""

import io
import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from small_library import library_with, make_ply

from app.errors import OutputError
from app.library.zip_stream import ZipStream
from app.recording.reader import Recording


def test_everything_in_the_folder_comes_out_again(tmp_path: Path) -> None:
    library = library_with(tmp_path / "scans", "mug")
    make_ply(tmp_path / "scans" / "mug" / "clouds" / "Größe.ply")
    (tmp_path / "scans" / "mug" / ".recording.json.part").touch()
    os.utime(tmp_path / "scans" / "mug" / "scan.json", (0, 0))
    stream = library.export("mug")
    data = b"".join(stream)
    assert len(data) == stream.length
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
        archive.extractall(tmp_path)
    assert len(Recording.open(tmp_path / "mug").entries) == 3
    assert (tmp_path / "mug" / "clouds" / "Größe.ply").exists()
    assert not (tmp_path / "mug" / ".recording.json.part").exists()


@pytest.mark.parametrize("limit", [20, 1000, 100_000])
def test_the_length_is_known_beforehand_also_where_the_zip_is_large(
    limit: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What takes four gigabytes in earnest begins here after a few bytes.
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", limit)
    for number in range(40):
        (tmp_path / f"{number}ü").write_bytes(b"x" * number * 50)
    stream = ZipStream(tmp_path, "mug")
    data = b"".join(stream)
    assert len(data) == stream.length
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert [len(archive.read(f"mug/{number}ü")) for number in (0, 39)] == [0, 39 * 50]


def test_the_length_is_known_beforehand_also_of_very_many_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zipfile, "ZIP_FILECOUNT_LIMIT", 5)
    for number in range(6):
        (tmp_path / str(number)).touch()
    stream = ZipStream(tmp_path, "mug")
    assert len(b"".join(stream)) == stream.length


def test_another_program_unpacks_it(tmp_path: Path) -> None:
    unzip = shutil.which("unzip")
    if unzip is None:
        pytest.skip("there is no unzip")
    (tmp_path / "z.zip").write_bytes(b"".join(library_with(tmp_path / "s", "mug").export("mug")))
    done = subprocess.run([unzip, "-tq", str(tmp_path / "z.zip")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_a_large_file_is_never_in_memory(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        file.truncate(20 << 20)
    sizes = [len(piece) for piece in ZipStream(tmp_path, "mug")]
    assert max(sizes) < 1 << 20
    assert sum(sizes) > 20 << 20


def test_a_file_that_changes_meanwhile_ends_the_stream(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(1 << 19))
    (tmp_path / "b").write_bytes(b"12345")
    (tmp_path / "c").touch()
    pieces = iter(ZipStream(tmp_path, "mug"))
    next(pieces)
    (tmp_path / "b").write_bytes(b"1")
    with pytest.raises(OutputError, match="shorter"):
        list(pieces)
    pieces = iter(ZipStream(tmp_path, "mug"))
    next(pieces)
    (tmp_path / "c").unlink()
    with pytest.raises(OutputError, match="c: no such file"):
        list(pieces)


def test_a_stream_that_nobody_reads_to_its_end_lets_go_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(1 << 20))
    pieces = iter(ZipStream(tmp_path, "mug"))
    next(pieces)
    pieces.close()
