"""The API described: routes and models without a scanner behind them, and the document that programs read."""

import json
import sys
import warnings
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from functools import cache
from pathlib import Path

from fastapi import FastAPI
from pydantic.warnings import UnsupportedFieldAttributeWarning

from app.api.described import TAGS, described
from app.api.problems import answer_problems
from app.api.versioned import API, versioned_routes


def api_application(
    lifespan: Callable[[FastAPI], AbstractAsyncContextManager[None]] | None = None,
) -> FastAPI:
    """All routes under their version; whoever serves them sets `state.services`."""
    # FastAPI silences it itself, but in a way that threads undo for each other.
    warnings.filterwarnings("ignore", category=UnsupportedFieldAttributeWarning)
    application = FastAPI(
        title="Turnscan", version="1", lifespan=lifespan, docs_url=None, redoc_url=None,
        openapi_url=f"{API}/openapi.json", description="A laser turntable scanner.", openapi_tags=TAGS,
        generate_unique_id_function=lambda route: route.name,
    )  # fmt: skip
    answer_problems(application)
    application.include_router(versioned_routes())
    plain = application.openapi
    # What programs are told of the API is what lies in the repository.
    application.openapi = cache(lambda: described(plain()))  # type: ignore[method-assign]
    return application


def api_document() -> str:
    """The OpenAPI document as it lies in the repository: the same routes give the same text."""
    return json.dumps(api_application().openapi(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(api_document(), "utf-8")
