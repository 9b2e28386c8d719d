"""The description of the API that lies in the repository is the one that the server gives."""

import json
from pathlib import Path

from app.api.document import api_application

_DOCUMENT = Path(__file__).resolve().parents[2] / "web" / "openapi.json"


def test_the_document_in_the_repository_describes_the_routes_there_are() -> None:
    written = json.loads(_DOCUMENT.read_text("utf-8"))
    assert written == json.loads(json.dumps(api_application().openapi())), (
        "run `make api` and commit what it writes"
    )
