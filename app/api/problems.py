"""Errors as RFC 9457 problems: the one place where a ScannerError becomes an answer."""

from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from app.api.headers import safe_headers
from app.errors import (
    AccessFileError,
    BenchBusy,
    BinChanged,
    BodyTooLarge,
    CalibrationError,
    CalibrationFileError,
    DeviceError,
    DeviceRefused,
    ImportFailed,
    JobRuns,
    NoPassword,
    NotLetIn,
    NotNow,
    NotThere,
    OptionError,
    OutputError,
    PasswordUnfit,
    PersonNeeded,
    PointCloudFileError,
    RecordingError,
    RefusedHere,
    ScanBusy,
    ScannerError,
    ScanNotFound,
    SurfaceError,
    TooLarge,
    TooManyAttempts,
)

_STATUS: tuple[tuple[type[ScannerError], HTTPStatus], ...] = (
    (NotThere, HTTPStatus.NOT_FOUND),
    (ScanNotFound, HTTPStatus.NOT_FOUND),
    (BenchBusy, HTTPStatus.CONFLICT),
    (ScanBusy, HTTPStatus.CONFLICT),
    (NotNow, HTTPStatus.CONFLICT),
    (BinChanged, HTTPStatus.CONFLICT),
    (TooLarge, HTTPStatus.REQUEST_ENTITY_TOO_LARGE),
    (ImportFailed, HTTPStatus.UNPROCESSABLE_ENTITY),
    (JobRuns, HTTPStatus.CONFLICT),
    (DeviceRefused, HTTPStatus.CONFLICT),
    (DeviceError, HTTPStatus.SERVICE_UNAVAILABLE),
    (OutputError, HTTPStatus.INSUFFICIENT_STORAGE),
    (RecordingError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (CalibrationFileError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (CalibrationError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (OptionError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (SurfaceError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (PointCloudFileError, HTTPStatus.UNPROCESSABLE_ENTITY),
    (NotLetIn, HTTPStatus.UNAUTHORIZED),
    (RefusedHere, HTTPStatus.FORBIDDEN),
    (PersonNeeded, HTTPStatus.FORBIDDEN),
    (TooManyAttempts, HTTPStatus.TOO_MANY_REQUESTS),
    (BodyTooLarge, HTTPStatus.REQUEST_ENTITY_TOO_LARGE),
    (PasswordUnfit, HTTPStatus.UNPROCESSABLE_ENTITY),
    (NoPassword, HTTPStatus.CONFLICT),
    (AccessFileError, HTTPStatus.SERVICE_UNAVAILABLE),
)
_MEDIA_TYPE = "application/problem+json"
_LONGEST_PATH = 200
_PLAIN_WORDS = {
    HTTPStatus.BAD_REQUEST: ("The body of the request cannot be read.", "Send JSON, as UTF-8."),
    HTTPStatus.NOT_FOUND: ("There is nothing at {path}.", "See the API's description, /api/v1/openapi.json."),
    HTTPStatus.METHOD_NOT_ALLOWED: ("{path} knows no {method}.", "The header Allow says what it knows."),
}
"""What to say, and what to do about it, instead of the two words that the standard has."""


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
        return answer_of(error)

    @application.exception_handler(RequestValidationError)
    def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        return _answer("invalid", f"{place}: {first['msg']}", HTTPStatus.UNPROCESSABLE_ENTITY, "")

    @application.exception_handler(HTTPException)
    def other(request: Request, error: HTTPException) -> JSONResponse:
        status = HTTPStatus(error.status_code)
        title, hint = _PLAIN_WORDS.get(status, (str(error.detail), ""))
        told = title.format(method=request.method, path=request.url.path[:_LONGEST_PATH])
        answer = _answer(status.phrase.lower().replace(" ", "-"), told, status, hint)
        answer.headers.update(error.headers or {})
        return answer

    @application.exception_handler(Exception)
    def surprise(request: Request, error: Exception) -> JSONResponse:
        title = "Something went wrong inside the server."
        answer = _answer("surprise", title, HTTPStatus.INTERNAL_SERVER_ERROR, "Its log says more.")
        # It is sent past everything that adds them otherwise.
        answer.headers.update(safe_headers(request))
        return answer


def answer_of(error: ScannerError) -> JSONResponse:
    """The answer that tells of it."""
    found = next((status for kind, status in _STATUS if isinstance(error, kind)), None)
    status = found or HTTPStatus.BAD_REQUEST
    answer = _answer(error.code, error.message, status, error.hint)
    if status == HTTPStatus.UNAUTHORIZED:
        answer.headers["WWW-Authenticate"] = 'Bearer realm="turnscan"'
    if status == HTTPStatus.REQUEST_ENTITY_TOO_LARGE:
        # Whatever is still on its way is not read.
        answer.headers["Connection"] = "close"
    if isinstance(error, TooManyAttempts):
        answer.headers["Retry-After"] = str(error.wait_s)
    return answer


def _answer(kind: str, title: str, status: HTTPStatus, hint: str) -> JSONResponse:
    problem = Problem(type=f"turnscan:{kind}", title=title, status=status, hint=hint)
    return JSONResponse(problem.model_dump(), status, media_type=_MEDIA_TYPE)
