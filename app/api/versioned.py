"""All routes of the first version: every module in `routes/` that has a `router`."""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from fastapi import APIRouter

from app.api import routes
from app.api.problems import Problem

API = "/api/v1"
_PROBLEMS: dict[int | str, dict[str, Any]] = {
    "4XX": {"model": Problem, "description": "What is wrong with the request."},
    "5XX": {"model": Problem, "description": "What the scanner cannot do now."},
}


def versioned_routes() -> APIRouter:
    """One router with all of them, in the order of their modules' names."""
    versioned = APIRouter(prefix=API, responses=_PROBLEMS)
    for name in sorted(module.name for module in iter_modules(routes.__path__)):
        versioned.include_router(import_module(f"{routes.__name__}.{name}").router)
    return versioned
