"""JSON documents that people also write by hand: read with every mistake named by its place in the file."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from app.errors import ScannerError
from app.files import reason

_MOST_BYTES = 256 * 2**20
_DEEPEST = 64
_LONGEST_SHOWN = 60

Json: TypeAlias = dict[str, Any]
Complain: TypeAlias = Callable[[str, str], ScannerError]
"""Builds the error from where (file and entry) and what is wrong."""


class Entry(BaseModel):
    """A part of a document: types are taken strictly, unknown keys are kept, numbers are finite."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    def as_json(self) -> Json:
        """What was given, unknown keys included, ready for `json.dumps`."""
        return self.model_dump(mode="json", exclude_unset=True)

    @property
    def unknown(self) -> Json:
        """Keys that this program does not know."""
        return dict(self.__pydantic_extra__ or {})


Model = TypeVar("Model", bound=Entry)


def read_document(path: Path, model: type[Model], complain: Complain) -> Model:
    """The JSON file at `path` as the model."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise complain(str(path), reason(error)) from error
    if len(data) > _MOST_BYTES:
        raise complain(str(path), f"is larger than {_MOST_BYTES // 2**20} MB")
    return parse_document(data, model, str(path), complain)


def parse_document(data: bytes, model: type[Model], where: str, complain: Complain) -> Model:
    """The bytes of a JSON file as the model; `where` names the file in messages."""
    try:
        text = data.decode("utf-8-sig")
        document = json.loads(text, object_pairs_hook=_without_repeats)
    except UnicodeDecodeError as error:
        raise complain(where, f"is not UTF-8 text (byte {error.start})") from error
    except json.JSONDecodeError as error:
        raise complain(where, f"is not JSON ({error.msg}, line {error.lineno})") from error
    except RecursionError as error:
        raise complain(where, "is nested too deeply") from error
    except ValueError as error:
        raise complain(where, str(error)) from error
    if not isinstance(document, dict):
        raise complain(where, "must hold a JSON object, as in {...}")
    _check_values(document, where, complain)
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        place, problem = _first_problem(error, document)
        raise complain(f"{where}: {place}" if place else where, problem) from error


def compose(model: type[Model], document: Json, where: str, complain: Complain) -> Model:
    """A model from values of this program, checked as if they had been read from a file."""
    try:
        data = json.dumps(document).encode()
    except (TypeError, ValueError) as error:
        raise complain(where, str(error)) from error
    return parse_document(data, model, where, complain)


def _without_repeats(pairs: list[tuple[str, Any]]) -> Json:
    made = dict(pairs)
    if len(made) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"has the key {_shown(twice)} twice in one object")
    return made


def _check_values(document: Json, where: str, complain: Complain) -> None:
    """Finite numbers and encodable text everywhere, unknown keys included."""
    waiting: list[tuple[str, Any, int]] = [("", document, 0)]
    while waiting:
        place, value, depth = waiting.pop()
        if depth > _DEEPEST:
            raise complain(where, "is nested too deeply")
        if isinstance(value, dict):
            for key, inner in value.items():
                if not _is_encodable(key):
                    raise complain(where, f"has a key that is not valid text: {key!a}")
                waiting.append((f"{place}.{key}" if place else key, inner, depth + 1))
        elif isinstance(value, list):
            waiting.extend((f"{place}[{i}]", inner, depth + 1) for i, inner in enumerate(value))
        elif isinstance(value, float) and not math.isfinite(value):
            raise complain(f"{where}: {place}", "must be a finite number")
        elif isinstance(value, str) and not _is_encodable(value):
            raise complain(f"{where}: {place}", f"is not valid text: {ascii(value)[:_LONGEST_SHOWN]}")


def _is_encodable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _first_problem(error: ValidationError, document: Json) -> tuple[str, str]:
    """Place and sentence of the first of possibly many problems."""
    problems = error.errors(include_url=False)
    first = problems[0]
    place = _place(first["loc"], document, is_missing=first["type"] == "missing")
    kind, given, context = first["type"], first["input"], first.get("ctx", {})
    if kind == "missing":
        sentence = "is missing"
    elif kind == "union_tag_not_found":
        place, sentence = f"{place}.kind", "is missing"
    elif kind == "union_tag_invalid":
        place, sentence = f"{place}.kind", f"must be {context['expected_tags']}, not {_shown(context['tag'])}"
    elif kind == "value_error":
        sentence = str(context["error"])
    else:
        sentence = f"{first['msg'].replace('Input should', 'must')}, not {_shown(given)}"
        sentence = sentence[:1].lower() + sentence[1:]
    others = len(problems) - 1
    return place, sentence + (f" (and {others} more problem{'s'[: others - 1]})" if others else "")


def _place(location: tuple[int | str, ...], document: Json, *, is_missing: bool) -> str:
    """`frames[12].role`; a part that names no key but the variant of a union is left out."""
    place, here = "", document
    for number, part in enumerate(location):
        if isinstance(part, int):
            place += f"[{part}]"
        elif isinstance(here, dict) and part not in here and not (is_missing and number + 1 == len(location)):
            continue
        else:
            place += f".{part}" if place else part
        try:
            here = here[part]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):
            here = {}
    return place


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list):
        return "a list"
    text = json.dumps(value) if value is None or isinstance(value, bool) else ascii(value)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."
