"""Whatever the server says by a code, or in a sentence of its own, the German page can say in German."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import app

_HOME = Path(app.__file__).parent
_GERMAN = json.loads((_HOME.parent / "web/src/i18n/server/de.json").read_text())
# Said by the API itself, and of jobs that ended with the program.
_OTHER_CODES = {"invalid", "bad-request", "not-found", "method-not-allowed", "surprise", "interrupted"}
_OPEN = re.compile(r"\{\w+\}")


def test_every_code_of_an_error_has_a_german_sentence() -> None:
    codes = set(_error_codes()) | _OTHER_CODES
    assert codes - set(_GERMAN["problems"]) == set()
    assert set(_GERMAN["problems"]) - codes == set()


def test_every_code_of_a_finding_has_a_german_sentence() -> None:
    codes = set(_finding_codes())
    assert codes - set(_GERMAN["findings"]) == set()
    assert set(_GERMAN["findings"]) - codes == set()


def test_every_number_of_a_finding_has_a_name() -> None:
    names = json.loads((_HOME.parent / "web/src/i18n/en/doctor.json").read_text())
    assert set(_number_keys()) - set(names) == set()


def test_sentences_that_are_told_apart_by_their_words_are_still_said_so() -> None:
    said = set(_sentences())
    gone = [english for english, _ in _GERMAN["phrases"] if _OPEN.sub("{}", english) not in said]
    assert gone == []


@pytest.mark.parametrize("part", ["findings", "problems"])
def test_german_is_no_english(part: str) -> None:
    for sentence, way_out in _GERMAN[part].values():
        assert sentence.endswith(".")
        assert not re.search(r"\b(the|and|which|with)\b", sentence + way_out)


def _error_codes() -> Iterator[str]:
    for path in _HOME.rglob("*.py"):
        for kind in (
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ClassDef)
        ):
            for line in (node for node in kind.body if isinstance(node, ast.Assign)):
                if getattr(line.targets[0], "id", "") == "code" and isinstance(line.value, ast.Constant):
                    yield str(line.value.value)


def _finding_codes() -> Iterator[str]:
    """As `Finding.code`, for each state and kind that a call may come to."""
    for path in (_HOME / "checkup").glob("*.py"):
        tree = ast.parse(path.read_text())
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
                if isinstance(call.func, ast.Name) and call.func.id == "Finding":
                    yield from _codes(call, function, tree)


def _number_keys() -> Iterator[str]:
    """Of what is assigned to `numbers`, or written where a finding takes them."""
    for path in (_HOME / "checkup").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            given: ast.expr | None = None
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "numbers":
                given = node.value
            if (
                isinstance(node, ast.Call)
                and getattr(node.func, "id", "") == "Finding"
                and len(node.args) > 4
            ):
                given = node.args[4]
            if isinstance(given, ast.Dict):
                yield from (str(key.value) for key in given.keys if isinstance(key, ast.Constant))


def _codes(call: ast.Call, function: ast.FunctionDef, tree: ast.Module) -> Iterator[str]:
    for check in _texts(call.args[0], function, tree) or {""}:
        group, _, thing = check.rstrip("{}").partition(".")
        said_of = f"{group}.{thing.partition('.')[0]}" if thing else "checkup"
        kind = call.args[5] if len(call.args) > 5 else None
        kind = next((each.value for each in call.keywords if each.arg == "kind"), kind)
        kinds = set() if kind is None else _texts(kind, function, tree)
        if kind is None or "" in kinds:
            kinds = (kinds - {""}) | _states(call.args[1], function)
        yield from (f"{said_of}.{each}" for each in kinds)


def _states(node: ast.expr, function: ast.FunctionDef) -> set[str]:
    nodes = [node, *_assigned(node, function)]
    return {
        n.attr.lower()
        for each in nodes
        for n in ast.walk(each)
        if _is_state(n) and isinstance(n, ast.Attribute)
    }


def _is_state(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "State"


def _texts(node: ast.expr, function: ast.FunctionDef, tree: ast.Module) -> set[str]:
    """What a string may be: written there, assigned before, or handed in as an argument of the function."""
    if isinstance(node, ast.Attribute) and node.attr == "kind":
        return _first_arguments(tree, "UnmeasuredError", 0)
    nodes = [node, *_assigned(node, function)]
    found = {_normal(each) for each in nodes if isinstance(each, ast.Constant | ast.JoinedStr)}
    found |= {
        str(side.value)
        for each in nodes
        if isinstance(each, ast.IfExp)
        for side in (each.body, each.orelse)
        if isinstance(side, ast.Constant)
    }
    names = [argument.arg for argument in function.args.args]
    if isinstance(node, ast.Name) and node.id in names:
        found |= _first_arguments(tree, function.name, names.index(node.id))
    return found


def _first_arguments(tree: ast.Module, name: str, at: int) -> set[str]:
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
    given = [call.args[at] for call in calls if getattr(call.func, "id", "") == name and len(call.args) > at]
    return {str(each.value) for each in given if isinstance(each, ast.Constant)}


def _assigned(node: ast.expr, function: ast.FunctionDef) -> list[ast.expr]:
    """The values of a name, alone or in pairs."""
    if not isinstance(node, ast.Name):
        return []
    found: list[ast.expr] = []
    for each in (n for n in ast.walk(function) if isinstance(n, ast.Assign)):
        target = each.targets[0]
        if isinstance(target, ast.Name) and target.id == node.id:
            found.append(each.value)
        if isinstance(target, ast.Tuple) and isinstance(each.value, ast.Tuple):
            pairs = zip(target.elts, each.value.elts, strict=True)
            found += [value for name, value in pairs if getattr(name, "id", "") == node.id]
    return found


def _sentences() -> Iterator[str]:
    """Every string in the program, whatever it leaves open as {}."""
    for path in _HOME.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant | ast.JoinedStr):
                yield _normal(node)


def _normal(node: ast.Constant | ast.JoinedStr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
