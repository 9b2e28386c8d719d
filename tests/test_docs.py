"""The documentation says what the program does: options with their defaults, examples, commands, links."""

import ast
import inspect
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
import tomlkit

from app.checkup.checkup import CHECKS
from app.cli.main import run
from app.devices.bench import Bench
from app.devices.bench_file import BenchDescription, parse_bench
from app.devices.camera_driver import CAMERAS, ControlName
from app.devices.turntable import TURNTABLES
from app.registry import Registry
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.world_plan import WorldPlan

_ROOT = Path(__file__).resolve().parents[1]
_DOCS = _ROOT / "docs"
_PAGES = (_ROOT / "README.md", *sorted(_DOCS.rglob("*.md")))
_WORLD_PAGE = _DOCS / "simulated-bench.md"
# Handed in by the program or by a test, never written into a bench file.
_HANDED_IN = frozenset({"world", "ask", "capture_class", "nodes", "platform", "load"})
# Tables of their own in a bench file.
_OWN_TABLES = frozenset({"platter", "board"})
_REGISTRIES: Mapping[str, Registry[Any]] = {"turntable": TURNTABLES, "camera": CAMERAS}
_FOLDERS = {"turntable": "boards", "camera": "cameras"}
_CODE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```", re.DOTALL | re.MULTILINE)
_ROW = re.compile(r"^\| `(\w+)` \| (.*?) \|", re.MULTILINE)
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_COMMAND = re.compile(r"\bturnscan ([a-z]+)\b([^`\n#]*)")
_OPTION = re.compile(r"(?<=\s)-{1,2}[a-zA-Z][a-z-]*")
_SENTENCE = re.compile(r"^\| \*(.+?)\* \|", re.MULTILINE)


def _page(kind: str, name: str) -> Path:
    """Of a driver."""
    return (
        _WORLD_PAGE if (kind, name) == ("turntable", "simulated") else _DOCS / _FOLDERS[kind] / f"{name}.md"
    )


_DRIVERS = [
    pytest.param(kind, name, id=f"{kind}-{name}")
    for kind, registry in _REGISTRIES.items()
    for name in registry
]


@pytest.mark.parametrize(("kind", "name"), _DRIVERS)
def test_every_driver_has_a_page_with_its_options_and_their_defaults(kind: str, name: str) -> None:
    page = _page(kind, name)
    wanted: dict[str, object] = {
        option: parameter.default
        for option, parameter in inspect.signature(_REGISTRIES[kind].maker(name)).parameters.items()
        if option not in _HANDED_IN
    }
    if page == _WORLD_PAGE:
        wanted |= {field.name: field.default for field in fields(WorldPlan) if field.name not in _OWN_TABLES}
    told = dict(_ROW.findall(_section(page.read_text(), "Options")))
    assert set(told) == set(wanted)
    for option, default in wanted.items():
        assert _means(told[option], default), (
            f"the page says {option} = {told[option]}, the driver {default!r}"
        )


@pytest.mark.parametrize(("kind", "name"), _DRIVERS)
def test_every_driver_has_a_whole_bench_file_on_its_page(kind: str, name: str) -> None:
    blocks = [
        text for _, language, text in _CODE.findall(_page(kind, name).read_text()) if language == "toml"
    ]
    whole = [document for document in map(tomllib.loads, blocks) if {"turntable", "camera"} <= set(document)]
    assert name in {document[kind]["driver"] for document in whole}


_EXAMPLES = [
    pytest.param(text, id=f"{page.relative_to(_ROOT)}-{number}")
    for page in _PAGES
    for number, (_, language, text) in enumerate(_CODE.findall(page.read_text()))
    if language == "toml"
]


@pytest.mark.parametrize("example", _EXAMPLES)
def test_every_example_of_a_bench_file_can_be_built(example: str) -> None:
    description = _description(example)
    for kind, entry in (("turntable", description.turntable), ("camera", description.camera)):
        taken = set(inspect.signature(_REGISTRIES[kind].maker(entry.driver)).parameters) - _HANDED_IN
        assert set(entry.options) <= taken
    with Bench.build(description) as bench:
        assert not bench.turntable.is_connected
        # A board tells what lasers it has once it is connected; those that know before must have these.
        known = bench.turntable.facts.laser_channels
        assert not known or {laser.channel for laser in description.lasers} <= set(known)


def test_the_bench_file_page_lists_every_control() -> None:
    told = dict(_ROW.findall(_section((_DOCS / "bench-file.md").read_text(), "Controls")))
    assert set(told) == set(ControlName)


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: str(page.relative_to(_ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in _LINK.findall(_without_code(page.read_text())):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        assert there.exists(), target
        if anchor:
            assert anchor in _anchors(there), target


@pytest.mark.parametrize("page", sorted(_DOCS.rglob("*.md")), ids=lambda page: str(page.relative_to(_DOCS)))
def test_every_page_can_be_found_from_the_index(page: Path) -> None:
    index = _DOCS / "README.md"
    listed = {(_DOCS / target.partition("#")[0]).resolve() for target in _LINK.findall(index.read_text())}
    assert page == index or page in listed


def test_every_command_and_option_that_is_mentioned_exists(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Wide enough that no option is cut off.
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setenv("TERMINAL_WIDTH", "300")
    mentioned: dict[tuple[str, ...], set[str]] = {}
    alone: set[str] = set()
    has_commands: dict[str, bool] = {}
    for page in _PAGES:
        alone.update(re.findall(r"`(--[a-z-]+)", page.read_text()))
        for command, rest in _COMMAND.findall(page.read_text()):
            if command not in has_commands:
                run([command, "--help"])
                has_commands[command] = "COMMAND [ARGS]" in capsys.readouterr().out
            words = (command, *re.findall(r"^ ([a-z]+)", rest)) if has_commands[command] else (command,)
            mentioned.setdefault(words, set()).update(_OPTION.findall(rest))
    assert {("scan",), ("doctor",), ("devices",), ("calibrations", "import")} <= set(mentioned)
    for words, options in mentioned.items():
        assert run([*words, "--help"]) == 0, words
        known = set(_OPTION.findall(capsys.readouterr().out))
        assert options <= known, words
        alone -= known
    assert not alone


@pytest.mark.parametrize(("page", "command"), [("scanning.md", "scan"), ("doctor.md", "doctor")])
def test_tables_of_options_are_whole(
    page: str, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setenv("TERMINAL_WIDTH", "300")
    run([command, "--help"])
    known = set(re.findall(r"│\s+(--[a-z-]+)", capsys.readouterr().out)) - {"--help"}
    rows = re.findall(r"^\| (`-[^|]*) \|", (_DOCS / page).read_text(), re.MULTILINE)
    assert {option for row in rows for option in re.findall(r"--[a-z-]+", row)} == known


def test_every_finding_of_the_doctor_is_explained() -> None:
    groups = "|".join(check.name for check in CHECKS)
    source = "\n".join(file.read_text() for file in sorted((_ROOT / "app" / "checkup").glob("*.py")))
    made = set(re.findall(rf'"((?:{groups})\.[a-z-]+)', source))
    told = set(re.findall(rf"`((?:{groups})\.[a-z-]+)", (_DOCS / "doctor.md").read_text()))
    assert told == made | {"board.connection", "camera.connection"}


def test_every_simulated_board_that_is_mentioned_exists_and_every_one_is_mentioned() -> None:
    text = "\n".join(page.read_text() for page in _PAGES)
    named = set(re.findall(r"\bsimulated:(\w+)|\bturnscan emulate (\w+)", text))
    assert {one or other for one, other in named} == set(FIRMWARES)


def test_every_sentence_that_is_explained_is_said_by_the_program() -> None:
    said = _sentences_of_the_program()
    for page in _PAGES:
        for sentence in _SENTENCE.findall(page.read_text()):
            pieces = [piece.strip(" '") for piece in sentence.split("…")]
            assert any(pieces)
            for piece in pieces:
                assert piece in said, f"{page.name}: nobody says {piece!r}"


def test_no_page_tells_of_a_path_of_somebody_s_own_machine() -> None:
    for page in _PAGES:
        assert not re.search(r"/(home|root|work|Users)/", page.read_text()), page


def _means(cell: str, default: object) -> bool:
    """Whether a cell of a table says the default: as TOML writes it, or in a word."""
    if default is inspect.Parameter.empty:
        return cell == "required"
    if default is None:
        return cell == "none"
    value = tomllib.loads(f"value = {cell.strip('`')}")["value"]
    if isinstance(default, float):
        return bool(value == pytest.approx(default, rel=1e-4))
    if isinstance(default, list | tuple):
        return list(value) == list(default)
    return type(value) is type(default) and value == default


def _section(text: str, heading: str) -> str:
    """What stands under a heading, up to the next."""
    found = re.search(rf"^## {heading}.*?\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
    assert found is not None, f"there is no section {heading!r}"
    return found[1]


def _description(example: str) -> BenchDescription:
    """An example as a bench; a device that a part of a file leaves out is any."""
    document = tomllib.loads(example)
    document.setdefault("turntable", {"driver": "manual"})
    document.setdefault("camera", {"driver": "uvc"})
    return parse_bench(tomlkit.dumps(document).encode(), "the example")


def _without_code(text: str) -> str:
    return re.sub(r"`[^`\n]*`", "", _CODE.sub("", text))


@lru_cache
def _anchors(page: Path) -> frozenset[str]:
    """Names that a page's headings have as targets of links."""
    headings = re.findall(r"^#+ (.*)$", _CODE.sub("", page.read_text()), re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)


@lru_cache
def _sentences_of_the_program() -> str:
    """All text in the program's source, pieces of one sentence together, blanks for what is filled in."""
    texts = []
    for file in sorted((_ROOT / "app").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                texts.append(
                    "".join(str(p.value) if isinstance(p, ast.Constant) else "" for p in node.values)
                )
    return "\n".join(texts)
