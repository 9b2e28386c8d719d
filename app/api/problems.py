"""Errors as RFC 9457 problems: the one place where a ScannerError becomes an answer."""

from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from app.errors import (
    BenchBusy,
    CalibrationFileError,
    DeviceError,
    JobRuns,
    NotThere,
    OptionError,
    OutputError,
    RecordingError,
    ScanBusy,
    ScannerError,
    ScanNotFound,
)

_STATUS: tuple[tuple[type[ScannerError], HTTPStatus], ...] = (
    (NotThere, HTTPStatus.NOT_FOUND),
    (ScanNotFound, HTTPStatus.NOT_FOUND),
    (BenchBusy, HTTPStatus.CONFLICT),
    (ScanBusy, HTTPStatus.CONFLICT),
    (JobRuns, HTTPStatus.CONFLICT),
    (DeviceError, HTTPStatus.SERVICE_UNAVAILABLE),
    (OutputError, HTTPStatus.INSUFFICIENT_STORAGE),
    (RecordingError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (CalibrationFileError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (OptionError, HTTPStatus.UNPROCESSABLE_ENTITY),
)
_MEDIA_TYPE = "application/problem+json"


class Problem(BaseModel):
    """What went wrong.

    Attributes:
        type: names the kind of problem, for programs.
        title: one sentence, for people.
        status: of the answer.
        hint: what to do.
    """

    type: str
    title: str
    status: int
    hint: str = ""


def answer_problems(application: FastAPI) -> None:
    """Have every error answered as a problem."""

    @application.exception_handler(ScannerError)
    def expected(request: Request, error: ScannerError) -> JSONResponse:
        status = next((status for kind, status in _STATUS if isinstance(error, kind)), None)
        return _answer(error.code, error.message, status or HTTPStatus.BAD_REQUEST, error.hint)

    @application.exception_handler(RequestValidationError)
    def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        return _answer("invalid", f"{place}: {first['msg']}", HTTPStatus.UNPROCESSABLE_ENTITY, "")

    @application.exception_handler(HTTPException)
    def other(request: Request, error: HTTPException) -> JSONResponse:
        return _answer("http", str(error.detail), HTTPStatus(error.status_code), "")


def _answer(kind: str, title: str, status: HTTPStatus, hint: str) -> JSONResponse:
    problem = Problem(type=f"turnscan:{kind}", title=title, status=status, hint=hint)
    return JSONResponse(problem.model_dump(), status, media_type=_MEDIA_TYPE)
