"""What no request may be, and the problem that says so."""

import itertools
from collections.abc import Iterator

import httpx2 as httpx
import pytest
from running_server import Running, running_server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running_server(tmp_path_factory.mktemp("server"), object="sphere") as server:
        yield server


@pytest.mark.parametrize(
    ("method", "path", "content", "status", "said"),
    [
        ("GET", "/nowhere", b"", 404, "There is nothing at /api/v1/nowhere."),
        ("PUT", "/bench", b"", 405, "/api/v1/bench knows no PUT."),
        ("OPTIONS", "/jobs", b"", 405, "OPTIONS"),
        ("POST", "/jobs/scan", b'{"steps": NaN}', 422, "steps"),
        ("POST", "/jobs/scan", b'{"steps": 1e400}', 422, "steps"),
        ("POST", "/jobs/scan", b'{"steps": ' + b"9" * 5000 + b"}", 400, "body"),
        ("POST", "/jobs/scan", b"[" * 100_000, 400, "body"),
        ("POST", "/jobs/scan", b"\xff\xfe", 422, "JSON"),
        ("POST", "/jobs/scan", b'{"steps":', 422, "JSON"),
        ("POST", "/bench/table", b'{"by_deg": Infinity}', 422, "by_deg"),
        ("POST", "/bench/table", b'{"by_deg": 1, "speed_deg_s": 1e-9}', 409, "1e-09 degrees"),
        ("POST", "/bench/camera/find-exposure", b'{"longest_us": NaN}', 422, "longest_us"),
        ("PUT", "/view/crop", b'{"low": [-Infinity, 0, 0], "high": [1, 1, 1]}', 422, "low"),
        ("PATCH", "/scans/nope", b'{"title": "a\\u0000b"}', 400, "title"),
        ("GET", "/scans/a%00b", b"", 404, ""),
        ("GET", "/scans/" + "a" * 3000, b"", 404, ""),
        ("GET", "/jobs/%F0%9F%A6%84%0A", b"", 404, ""),
        ("GET", "/scans/nope/pictures/" + "9" * 400, b"", 404, ""),
        ("DELETE", "/scans/bin?frees=" + "9" * 4000, b"", 409, ""),
    ],
    ids=itertools.count(),
)
def test_what_cannot_be_is_refused_as_a_problem_that_names_it(
    server: Running, method: str, path: str, content: bytes, status: int, said: str
) -> None:
    headers = {"content-type": "application/json"}
    answer = httpx.request(method, server.http + path, content=content, headers=headers, timeout=60.0)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert said in problem["title"]
    assert problem["type"] != "turnscan:surprise"
    if status == 405:
        assert answer.headers["allow"]
