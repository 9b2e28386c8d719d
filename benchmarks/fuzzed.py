"""Requests made up from the API's description, fitting and not, and what is wrong with their answers."""

import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.core.result import Err
from schemathesis.core.transport import Response
from schemathesis.schemas import APIOperation
from schemathesis.specs.openapi.checks import content_type_conformance, response_schema_conformance

from app.api.versioned import API

# Streams that never end, a password that locks everybody out, another bench than the one that is tried.
_LEFT_OUT = frozenset(
    {f"{API}/events/stream", f"{API}/live/{{kind}}.mjpeg", f"{API}/access/password", f"{API}/devices/choose"}
)
# A device or a disk that is not as it should be.
_EXPECTED = frozenset({503, 507})
_PROBLEM = "application/problem+json"
_PATIENCE_S = 120.0


@dataclass(slots=True)
class Fuzzed:
    """What came of it.

    Attributes:
        operations: that were tried.
        requests: that were sent.
        statuses: how often each was answered.
        slowest_s: of all answers.
        slowest: which that was.
        faults: what is wrong, one text each.
    """

    operations: int = 0
    requests: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    slowest_s: float = 0.0
    slowest: str = ""
    faults: list[str] = field(default_factory=list)


class Fuzzer:
    """Asks a server that is there to be asked anything: it moves the table, and starts and cancels jobs.

    Args:
        address: of the server, such as `http://localhost:8000`.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._session = requests.Session()
        self._found = Fuzzed()

    def run(self, examples: int) -> Fuzzed:
        """As many requests for each operation that fit its description, and as many that do not."""
        document = self._session.get(f"{self._address}{API}/openapi.json", timeout=_PATIENCE_S).json()
        for result in schemathesis.openapi.from_dict(document).get_all_operations():
            if isinstance(result, Err):
                self._found.faults.append(str(result.err()))
                continue
            operation = result.ok()
            if operation.path in _LEFT_OUT:
                continue
            self._found.operations += 1
            for mode in GenerationMode:
                self._try(operation, mode, examples)
        self._session.close()
        return self._found

    def _try(self, operation: APIOperation[Any, Any, Any, Any], mode: GenerationMode, examples: int) -> None:
        chosen = settings(
            max_examples=examples, deadline=None, derandomize=True, database=None,
            phases=(Phase.generate,), suppress_health_check=list(HealthCheck),
        )  # fmt: skip
        with suppress(Unsatisfiable):
            # Where nothing is taken, nothing can be unfit.
            given(operation.as_strategy(generation_mode=mode))(chosen(lambda case: self._ask(case)))()

    def _ask(self, case: Case[Any]) -> None:
        begun_s = time.monotonic()
        answer = case.call(base_url=self._address, session=self._session, timeout=_PATIENCE_S)
        took_s = time.monotonic() - begun_s
        found = self._found
        found.requests += 1
        found.statuses[answer.status_code] += 1
        if took_s > found.slowest_s:
            found.slowest_s, found.slowest = took_s, case.operation.label
        if fault := _fault(case, answer):
            found.faults.append(
                f"{case.as_curl_command()}\n  {answer.status_code} {answer.text[:300]}\n  {fault}"
            )
        self._cancel(answer)

    def _cancel(self, answer: Response) -> None:
        """A job that was begun, so that the bench is there for the next."""
        told = answer.json() if answer.status_code == 200 and "json" in _media_type(answer) else None
        if isinstance(told, dict) and "can_resume" in told and told["ended"] is None:
            self._session.post(f"{self._address}{API}/jobs/{told['id']}/cancel", timeout=_PATIENCE_S)


def _fault(case: Case[Any], answer: Response) -> str:
    """What is wrong with an answer; empty for nothing."""
    if answer.status_code >= 500 and answer.status_code not in _EXPECTED:
        return "is a surprise"
    if answer.status_code >= 400 and _media_type(answer) != _PROBLEM:
        return "is no problem as it should be described"
    try:
        case.validate_response(answer, checks=[response_schema_conformance, content_type_conformance])
    except AssertionError as error:
        return str(error)
    except BaseExceptionGroup as errors:
        return str(errors.exceptions[0])
    return ""


def _media_type(answer: Response) -> str:
    return next(iter(answer.headers.get("content-type", [])), "").partition(";")[0]
