"""`turnscan library` as a person uses it."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from command_line import turnscan
from typer.testing import CliRunner

from app.cli.library import library_app
from app.library.library import Library
from app.surface.ply_reader import read_ply


@pytest.fixture
def here(small_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a library of one scan, `ball`; its pictures are links."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    shutil.copytree(small_recording, tmp_path / "scans" / "ball", copy_function=os.link)
    return tmp_path


def test_the_list_shows_names_titles_and_room(here: Path) -> None:
    assert turnscan("library", "rename", "ball", "A [red] ball").code == 0
    ended = turnscan("library", "list")
    assert ended.code == 0
    assert "A [red] ball" in ended.said
    assert "free" in ended.said
    assert "no scan in other" in turnscan("library", "list", "--library", "other").said
    assert not (here / "other").exists()


def test_a_scan_goes_out_and_comes_in(here: Path) -> None:
    assert turnscan("library", "note", "ball", "first [line]\nsecond").code == 0
    assert turnscan("library", "export", "ball").code == 0
    ended = turnscan("library", "import", "ball.zip", "--title", "Another", "--library", "other")
    assert ended.code == 0
    assert "first [line]" in ended.said
    assert "Another" in turnscan("library", "show", "another", "--library", "other").said


def test_a_scan_goes_out_through_a_pipe(here: Path) -> None:
    command = [sys.executable, "-m", "app", "library", "export", "ball", "-o", "-"]
    done = subprocess.run(
        command, capture_output=True, env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout) == Library(here / "scans").export("ball").length
    (here / "piped.zip").write_bytes(done.stdout)
    with zipfile.ZipFile(here / "piped.zip") as archive:
        assert archive.testzip() is None


def test_what_is_thrown_away_comes_back_or_is_erased(here: Path) -> None:
    ended = turnscan("library", "delete", "ball")
    assert ended.code == 0
    assert "turnscan library restore" in ended.said
    assert "ball" in turnscan("library", "list", "--bin").said
    assert turnscan("library", "restore", "ball").code == 0
    assert (here / "scans" / "ball" / "recording.json").exists()
    turnscan("library", "delete", "ball")
    assert "1 scan erased" in turnscan("library", "empty", "--yes").said
    assert "The bin is empty." in turnscan("library", "list", "--bin").said
    assert "The bin is empty." in turnscan("library", "empty").said


def test_emptying_asks_first(here: Path) -> None:
    turnscan("library", "delete", "ball")
    runner = CliRunner()
    assert runner.invoke(library_app, ["empty"], input="n\n").exit_code != 0
    assert len(Library(here / "scans").bin()) == 1
    assert runner.invoke(library_app, ["empty"], input="y\n").exit_code == 0
    assert Library(here / "scans").bin() == ()


def test_a_scan_is_computed_again(here: Path) -> None:
    ended = turnscan("library", "reconstruct", "ball")
    assert ended.code == 2
    assert "--calibration" in ended.sentence
    ended = turnscan("library", "reconstruct", "ball", "-c", "scans/ball/truth.json", "--above", 5)
    assert ended.code == 0, ended.said
    (cloud,) = Library(here / "scans").scan("ball").clouds
    assert len(read_ply(here / "scans" / "ball" / cloud.name)) == cloud.points > 0
    assert cloud.name in ended.said
    assert cloud.name in turnscan("library", "show", "ball").said


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["show", "../ball"], "no scan called"), (["delete", "nothing"], "no scan called"),
        (["restore", "nothing"], "in the bin"), (["rename", "ball", " "], "title"),
        (["import", "scans"], "no recording"), (["import", "nothing.zip"], "no such file"),
        (["export", "ball", "-o", "nowhere/x.zip"], "not there"),
        (["reconstruct", "ball", "-c", "scans/ball/truth.json", "--detector", "x"], "stripe detector"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_told_in_a_sentence(words: list[str], told: str, here: Path) -> None:
    ended = turnscan("library", *words)
    assert ended.code == 2
    assert told in ended.sentence
    assert (here / "scans" / "ball").is_dir()
