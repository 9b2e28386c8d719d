"""The description of the API that lies in the repository is the one that the server gives, and whole."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest

from app.api.document import api_application
from app.api.examples import EXAMPLES
from app.api.news_models import EventOut

_ROOT = Path(__file__).resolve().parents[2]
_SCHEMAS = "#/components/schemas/"
# How a page writes a request: a method, and a path that begins with a slash.
_REQUEST = re.compile(r"\b(GET|POST|PATCH|PUT|DELETE|WS) (/[^\s`?|]*)")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    told: dict[str, Any] = json.loads(json.dumps(api_application().openapi()))
    return told


def test_the_document_in_the_repository_describes_the_routes_there_are(document: dict[str, Any]) -> None:
    written = json.loads((_ROOT / "web" / "openapi.json").read_text("utf-8"))
    assert written == document, "run `make api` and commit what it writes"


def test_every_operation_has_a_name_words_a_tag_and_its_problems(document: dict[str, Any]) -> None:
    tags = {tag["name"] for tag in document["tags"] if tag["description"]}
    names = Counter(operation["operationId"] for operation in _operations(document))
    assert set(names.values()) == {1}
    for operation in _operations(document):
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", operation["operationId"])
        assert operation["summary"]
        assert operation["description"]
        assert set(operation["tags"]) <= tags
        for status in ("4XX", "5XX"):
            assert list(operation["responses"][status]["content"]) == ["application/problem+json"]
    assert not [name for name in document["components"]["schemas"] if "__" in name]


def test_whatever_goes_in_or_out_has_an_example(document: dict[str, Any]) -> None:
    for operation in _operations(document):
        answers = [answer for status, answer in operation["responses"].items() if status.startswith("2")]
        for name in _models([operation.get("requestBody"), answers]):
            assert document["components"]["schemas"][name]["examples"], name
    events = {kind.__name__ for kind in EventOut.__args__}
    assert events <= set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_is_valid(document: dict[str, Any], name: str) -> None:
    schema = {"$ref": _SCHEMAS + name, "components": document["components"]}
    jsonschema_rs.validator_for(schema).validate(EXAMPLES[name])


def test_every_request_that_a_page_names_exists(document: dict[str, Any]) -> None:
    known = {
        (method.upper(), re.sub(r"\{[^}]*\}", "{}", path.removeprefix("/api/v1")))
        for path, operations in document["paths"].items()
        for method in operations
    } | {
        ("WS", re.sub(r"\{[^}]*\}", "{}", path.removeprefix("/api/v1"))) for path in document["x-websockets"]
    }
    page = (_ROOT / "docs" / "api.md").read_text()
    named = {(method, re.sub(r"\{[^}]*\}", "{}", path)) for method, path in _REQUEST.findall(page)}
    assert len(named) >= 30
    assert named <= known
    for path in re.findall(r"\$API(/[^\s\"?\\]*)", page):
        fits = re.compile("|".join(re.escape(each).replace(r"\{\}", "[^/]+") for _, each in known))
        assert fits.fullmatch(re.sub(r"\$\w+", "x", path)), path


def _operations(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for operations in document["paths"].values():
        yield from operations.values()


def _models(part: Any) -> Iterator[str]:
    if isinstance(part, dict):
        if "$ref" in part:
            yield part["$ref"].removeprefix(_SCHEMAS)
        for each in part.values():
            yield from _models(each)
    elif isinstance(part, list):
        for each in part:
            yield from _models(each)
