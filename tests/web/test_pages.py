"""How the built page goes out, and what is shown where it was not built."""

from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from starlette.applications import Starlette

from app.api.pages import page_routes


@pytest.fixture
def built(tmp_path: Path) -> Path:
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<p>page</p>")
    (tmp_path / "assets" / "main-1a2b.js").write_text("plain")
    (tmp_path / "assets" / "main-1a2b.js.gz").write_bytes(b"packed")
    return tmp_path


@pytest.mark.parametrize("path", ["/", "/scan", "/library/a%20mug", "/settings"])
def test_every_place_is_the_same_page_under_a_strict_policy(built: Path, path: str) -> None:
    answer = TestClient(Starlette(routes=page_routes(built))).get(path)
    assert answer.text == "<p>page</p>"
    assert answer.headers["cache-control"] == "no-cache"
    assert "unsafe" not in answer.headers["content-security-policy"]


def test_files_are_kept_for_ever_and_nothing_else_is_handed_out(built: Path) -> None:
    client = TestClient(Starlette(routes=page_routes(built)))
    answer = client.get("/assets/main-1a2b.js", headers={"accept-encoding": "identity"})
    assert (answer.text, answer.headers["content-type"]) == ("plain", "text/javascript; charset=utf-8")
    assert "immutable" in answer.headers["cache-control"]
    with client.stream("GET", "/assets/main-1a2b.js", headers={"accept-encoding": "gzip"}) as packed:
        assert packed.headers["content-encoding"] == "gzip"
    for path in ("/assets/..%2findex.html", "/assets/nothing.js", "/.stamp", "/nowhere"):
        assert client.get(path).status_code == 404


def test_a_page_that_was_not_built_says_how_to_build_it(tmp_path: Path) -> None:
    answer = TestClient(Starlette(routes=page_routes(tmp_path))).get("/")
    assert answer.status_code == 503
    assert "make run" in answer.text
