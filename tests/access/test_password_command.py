"""`turnscan password`, as somebody on the scanner's own machine uses it."""

import io
from pathlib import Path

import pytest

from app.access.access import Access
from app.access.state import FILE
from app.cli.main import run


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_password_is_read_made_and_removed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("a turntable and a laser\n"))
    assert run(["password", "--folder", "kept"]) == 0
    access = Access.open(Path("kept"))
    access.log_in("a turntable and a laser", "", "x")
    capsys.readouterr()
    assert run(["password", "--new", "--folder", "kept"]) == 0
    access.log_in(capsys.readouterr().out.strip(), "", "x")
    assert run(["password", "--remove", "--folder", "kept"]) == 0
    assert not access.has_password


def test_tokens_are_made_listed_and_ended(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["password", "tokens", "make", "script"]) == 2
    assert "`turnscan password`" in capsys.readouterr().err
    assert run(["password", "--new"]) == 0
    capsys.readouterr()
    assert run(["password", "tokens", "make", "script"]) == 0
    assert Access.open(Path()).let_in_by_token(capsys.readouterr().out.strip()) is not None
    assert run(["password", "tokens", "list", "--folder", "."]) == 0
    assert "script" in capsys.readouterr().err
    assert run(["password", "--folder", ".", "tokens", "end", "script"]) == 0
    assert run(["password", "tokens", "end", "script"]) == 2
    assert "no token called 'script'" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--new", "--remove"], ["--new", "tokens", "list"]])
def test_what_excludes_each_other_is_said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["password", *arguments]) == 2
    assert "--new and --remove" in capsys.readouterr().err


def test_out_of_a_damaged_file_leads_what_its_error_says(capsys: pytest.CaptureFixture[str]) -> None:
    Path(FILE).write_text("damaged")
    assert run(["password", "--new"]) == 2
    assert "turnscan password --remove" in " ".join(capsys.readouterr().err.split())
    assert run(["password", "--remove"]) == 0
    assert run(["password", "--new"]) == 0
