"""A served folder with a password: who gets in, who does not, and what ends when the right to it does."""

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest
import uvicorn
from fastapi import FastAPI
from fastapi.testclient import TestClient
from starlette.types import Message
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection

from app.access.access import Access
from app.access.attempts import Attempts
from app.access.password import Hashing
from app.access.state import FILE
from app.api.browser import browser_words
from app.api.guard import NOT_LOGGED_IN, is_local_path
from app.api.held import SocketEnded, ending_socket
from app.api.login_page import language_of
from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.main import create_app
from app.settings import Settings
from app.viewer.page import viewer_page
from app.viewer.proxy import SOCKET_OPTIONS

PASSWORD = "a turntable and a laser"
PATIENCE_S = 60.0
SESSION, TLS_SESSION = "turnscan", "__Host-turnscan"


class Clock:
    """Of the attempts: stands still unless a test moves it."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@dataclass(frozen=True)
class Server:
    """One that is asked over the network, and its parts."""

    application: FastAPI
    access: Access
    folder: Path
    clock: Clock
    port: int

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def stranger(self, **headers: str) -> httpx.Client:
        return httpx.Client(base_url=self.url, headers=headers, trust_env=False, timeout=PATIENCE_S)

    @contextlib.contextmanager
    def somebody(self) -> Iterator[httpx.Client]:
        """Who has logged in."""
        with self.stranger() as client:
            assert client.post(f"{API}/access/login", json={"password": PASSWORD}).status_code == 200
            yield client

    def socket(self, path: str, **headers: str) -> ClientConnection:
        protocol: Any = [viewer_page().dialect] if path.startswith("/view") else None
        return connect(
            f"ws://127.0.0.1:{self.port}{path}", additional_headers=headers, subprotocols=protocol,
            proxy=None, open_timeout=PATIENCE_S, close_timeout=1.0, max_size=None,
        )  # fmt: skip


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder, clock = tmp_path_factory.mktemp("served"), Clock()
    access = Access.open(folder, hashing=Hashing(memory_kib=64, passes=1), attempts=Attempts(clock))
    access.set_password(PASSWORD)
    description = simulated_description("horus", object="sphere", width=320, height=240, rate=10.0)
    application = create_app(Settings(folder, "simulated"), description, access, lambda: ["127.0.0.1"])
    config = uvicorn.Config(
        application, port=0, log_level="warning", timeout_graceful_shutdown=5, **SOCKET_OPTIONS
    )
    serving = uvicorn.Server(config)
    thread = threading.Thread(target=serving.run, daemon=True)
    thread.start()
    _wait(lambda: serving.started)
    port = serving.servers[0].sockets[0].getsockname()[1]
    yield Server(application, access, folder, clock, port)
    serving.should_exit = True
    thread.join(PATIENCE_S)


@pytest.fixture(autouse=True)
def later(server: Server) -> Iterator[None]:
    """Each test begins with the password set and no attempt remembered."""
    server.clock.now_s += 10_000.0
    yield
    (server.folder / FILE).unlink(missing_ok=True)
    server.access.set_password(PASSWORD)


def _routes(server: Server) -> list[tuple[str, str]]:
    """Method and path of everything in the API."""
    described = server.application.openapi()["paths"]
    return [(method.upper(), path) for path, ways in described.items() for method in ways]


def test_before_the_login_nothing_but_the_login_is_served(server: Server) -> None:
    with server.stranger() as stranger:
        for method, path in _routes(server):
            filled = path.replace("{", "").replace("}", "")
            if (method, path) in {("GET", f"{API}/access"), ("POST", f"{API}/access/login")}:
                continue
            answer = stranger.request(method, filled)
            assert answer.status_code == 401, (method, path)
            assert answer.json()["type"] == "turnscan:not-logged-in"
            assert answer.json()["hint"]
            assert answer.headers["www-authenticate"].startswith("Bearer")
        for path in ("/", "/view/", "/view/tab", "/metrics", f"{API}/openapi.json", "/start/start.js", "/x"):
            assert stranger.get(path).status_code == 401, path
        for path in ("/login", "/login/login.js", "/login/login.css", f"{API}/access"):
            assert stranger.get(path).status_code == 200, path
        assert stranger.get(f"{API}/access").json() == {
            "password_is_set": True, "is_let_in": False, "by": None
        }  # fmt: skip
        assert stranger.get("/healthz", headers={"host": "anything"}).text == "ok"
        assert stranger.head("/healthz").status_code == 200
    for path in (f"{API}/events", f"{API}/live/overlay", "/view/tab"):
        with server.socket(path) as socket, pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == NOT_LOGGED_IN


def test_a_page_leads_to_the_login_and_back_but_not_elsewhere(server: Server) -> None:
    with server.stranger(accept="text/html") as stranger:
        told = stranger.get("/library/a%20scan?sort=name")
        assert told.status_code == 303
        assert told.headers["location"] == "/login?next=%2Flibrary%2Fa%2520scan%3Fsort%3Dname"
        assert stranger.get("/").headers["location"] == "/login"
        assert stranger.get("/view/", headers={"sec-fetch-dest": "iframe"}).status_code == 401
        assert stranger.get("/login?next=/library").status_code == 200
        for wrong in ("//evil.example", "/%5Cevil.example", "https://evil.example", "x", "/%0D%0Ax"):
            assert stranger.get(f"/login?next={wrong}").headers["location"] == "/login"
    assert is_local_path("/a?b#c")
    assert not any(map(is_local_path, ("", "a", "//a", "/\\a", "/a\n", "/" + "a" * 3000)))


def test_a_session_is_kept_in_a_cookie_that_no_script_and_no_other_site_can_use(server: Server) -> None:
    with server.stranger(**{"user-agent": "Mozilla/5.0 (X11; Linux) Firefox/1"}) as client:
        answer = client.post(f"{API}/access/login", json={"password": PASSWORD})
        assert answer.json() == {"password_is_set": True, "is_let_in": True, "by": "session"}
        cookie = answer.headers["set-cookie"]
        assert cookie.startswith(f"{SESSION}=")
        assert {"HttpOnly", "Path=/", "SameSite=strict", "Max-Age=2592000"} <= set(cookie.split("; "))
        assert "Secure" not in cookie
        assert "Domain" not in cookie
        assert client.get(f"{API}/bench").status_code == 200
        # A password lets every name and address be served.
        assert client.get(f"{API}/bench", headers={"host": "scanner.example"}).status_code == 200
        assert [each["browser"] for each in client.get(f"{API}/access/sessions").json()] == [
            "Firefox on Linux"
        ]
        left = client.post(f"{API}/access/logout")
        assert left.json()["is_let_in"] is False
        assert f'{SESSION}="";' in left.headers["set-cookie"]
        assert client.get(f"{API}/bench").status_code == 401
    encrypted = TestClient(server.application, base_url="https://scanner.example")
    answer = encrypted.post(f"{API}/access/login", json={"password": PASSWORD})
    assert answer.headers["set-cookie"].startswith(f"{TLS_SESSION}=")
    assert {"Secure", "HttpOnly", "Path=/"} <= set(answer.headers["set-cookie"].split("; "))
    assert "max-age" in answer.headers["strict-transport-security"]
    assert encrypted.get(f"{API}/access").json()["is_let_in"] is True


def test_a_code_lets_one_phone_in_and_only_where_the_server_is(server: Server) -> None:
    with server.somebody() as client, server.stranger() as phone:
        about = client.get(f"{API}/server").json()
        assert about["addresses"] == [server.url]
        code = client.post(f"{API}/server/phone-code", json={}).json()
        address, key = code["link"].split("/login#key=")
        assert address == server.url
        assert {len(row) for row in code["rows"]} == {len(code["rows"])}
        assert phone.post(f"{API}/access/login", json={"key": key}).json()["by"] == "session"
        assert phone.get(f"{API}/server").status_code == 200
        assert phone.post(f"{API}/access/login", json={"key": key}).status_code == 401
        elsewhere = client.post(f"{API}/server/phone-code", json={"address": "http://evil.example"})
        assert (elsewhere.status_code, elsewhere.json()["hint"]) == (404, "Choose one that is listed.")
        token = client.post(f"{API}/access/tokens", json={"name": "a program"}).json()["secret"]
    with server.stranger(Authorization=f"Bearer {token}") as program:
        assert program.post(f"{API}/server/phone-code", json={}).status_code == 403


def test_what_is_wrong_at_the_login_is_told_in_plain_words(server: Server) -> None:
    with server.stranger() as client:
        for body, status, said in (
            ({"password": "not it"}, 401, "That is not the password."),
            ({"password": "x" * 999}, 401, "That is not the password."),
            ({"key": "never made"}, 401, "This link has been used already"),
            ({}, 401, "not the password"),
            ({"password": "x" * 5000}, 422, "password"),
            ({"password": "x" * 20_000}, 413, "at most"),
        ):
            answer = client.post(f"{API}/access/login", json=body)
            assert answer.status_code == status, body
            assert said in answer.json()["title"]
            assert "set-cookie" not in answer.headers
        endless = (b" " * 1000 for _ in range(100))
        assert client.post(f"{API}/access/login", content=endless).status_code == 413
        key = server.access.one_time_key()
        assert client.post(f"{API}/access/login", json={"key": key}).status_code == 200
        assert client.get(f"{API}/bench").status_code == 200
        assert client.post(f"{API}/access/login", json={"key": key}).status_code == 401


def test_twenty_wrong_passwords_at_once_hold_nobody_up_who_is_logged_in(server: Server) -> None:
    def attempt(_: int) -> httpx.Response:
        with server.stranger() as client:
            return client.post(f"{API}/access/login", json={"password": "guessed"})

    with server.somebody() as client, ThreadPoolExecutor(20) as pool:
        attempts = [pool.submit(attempt, number) for number in range(20)]
        assert client.get(f"{API}/bench").status_code == 200
        answers = [each.result() for each in attempts]
        assert client.get(f"{API}/bench").status_code == 200
    told = [answer.status_code for answer in answers]
    assert set(told) <= {401, 429}
    assert told.count(401) <= Attempts.each.free
    # Some found the line full and were not counted; the right one waits now, too.
    late = [attempt(number) for number in range(Attempts.each.free + 1)][-1]
    assert late.status_code == 429
    assert int(late.headers["retry-after"]) >= 1
    assert "too many attempts" in late.json()["title"]
    assert "second" in late.json()["hint"]
    with server.stranger() as client:
        assert client.post(f"{API}/access/login", json={"password": PASSWORD}).status_code == 429
        server.clock.now_s += 1000.0
        assert client.post(f"{API}/access/login", json={"password": PASSWORD}).status_code == 200


def test_a_token_lets_a_program_in_but_not_change_who_is_let_in(server: Server) -> None:
    with server.somebody() as person:
        made = person.post(f"{API}/access/tokens", json={"name": "script"}).json()
        assert person.post(f"{API}/access/tokens", json={"name": "script"}).status_code == 422
        with server.stranger(authorization=f"Bearer {made['secret']}") as program:
            assert program.get(f"{API}/access").json()["by"] == "token"
            stop = program.post(f"{API}/bench/stop", headers={"origin": "http://elsewhere.example"})
            assert stop.status_code == 200
            for method, path in (
                ("GET", "sessions"),
                ("GET", "tokens"),
                ("POST", "tokens"),
                ("POST", "password"),
            ):
                answer = program.request(method, f"{API}/access/{path}", json={"name": "x", "new": "y" * 9})
                assert answer.status_code == 403, path
            with server.socket(f"{API}/events", authorization=f"Bearer {made['secret']}") as socket:
                (token,) = person.get(f"{API}/access/tokens").json()
                assert token["last_used"] is not None
                assert made["secret"] not in json.dumps(token)
                assert person.delete(f"{API}/access/tokens/{token['id']}").json() == []
                assert _close_code(socket) == NOT_LOGGED_IN
            assert program.get(f"{API}/bench").status_code == 401
        assert person.delete(f"{API}/access/tokens/nope").status_code == 404
        # A wrong token is refused, even with a cookie beside it.
        wrong = person.get(f"{API}/bench", headers={"authorization": "Bearer wrong"})
        assert wrong.status_code == 401


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:1"},
        {"origin": "http://["},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "cors"},
    ],
)
def test_another_page_cannot_use_the_session(server: Server, headers: dict[str, str]) -> None:
    with server.somebody() as client:
        answer = client.post(f"{API}/bench/stop", headers=headers)
        assert answer.status_code == 403
        assert "own pages" in answer.json()["title"]
        cookie = f"{SESSION}={client.cookies[SESSION]}"
        for path in (f"{API}/events", f"{API}/live/overlay", "/view/"):
            with pytest.raises(InvalidStatus) as refused:
                server.socket(path, cookie=cookie, **headers)
            assert refused.value.response.status_code == 403
        own = {"origin": server.url, "sec-fetch-site": "same-origin"}
        assert client.post(f"{API}/bench/stop", headers=own).status_code == 200
        link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
        assert client.get("/", headers=link).status_code != 403


def test_what_is_open_ends_with_the_session(server: Server) -> None:
    with server.somebody() as person, server.somebody() as other:
        cookie = f"{SESSION}={other.cookies[SESSION]}"
        sockets = [
            server.socket(path, cookie=cookie) for path in (f"{API}/events", f"{API}/live/raw", "/view/a")
        ]
        stays = server.socket(f"{API}/events", cookie=f"{SESSION}={person.cookies[SESSION]}")
        with (
            other.stream("GET", f"{API}/events/stream") as news,
            other.stream("GET", f"{API}/live/raw.mjpeg") as pictures,
        ):
            sessions = person.get(f"{API}/access/sessions").json()
            assert [each["is_this"] for each in sessions].count(True) == 1
            theirs = next(each["id"] for each in sessions if not each["is_this"])
            assert len(person.delete(f"{API}/access/sessions/{theirs}").json()) == 1
            for socket in sockets:
                assert _close_code(socket) == NOT_LOGGED_IN
            # They end; that they do is all there is to see.
            for stream in (news, pictures):
                for _ in stream.iter_raw():
                    pass
        assert other.get(f"{API}/bench").status_code == 401
        assert person.delete(f"{API}/access/sessions/{theirs}").status_code == 404
        stays.ping().wait(PATIENCE_S)
        person.post(f"{API}/access/logout")
        assert _close_code(stays) == NOT_LOGGED_IN


def test_an_expired_session_is_over_wherever_it_is_used(server: Server) -> None:
    with server.somebody() as client:
        socket = server.socket(f"{API}/events", cookie=f"{SESSION}={client.cookies[SESSION]}")
        content = json.loads((server.folder / FILE).read_text())
        for session in content["sessions"]:
            session["expires"] = (datetime.now(UTC) - timedelta(seconds=1)).isoformat()
        (server.folder / FILE).write_text(json.dumps(content))
        _wait(lambda: client.get(f"{API}/bench").status_code == 401)
        assert _close_code(socket) == NOT_LOGGED_IN


def test_another_password_needs_the_old_one_and_logs_everybody_else_out(server: Server) -> None:
    with server.somebody() as client, server.somebody() as other:
        for old, new, status in (("wrong", "something else", 401), (PASSWORD, "short", 422)):
            answer = client.post(f"{API}/access/password", json={"old": old, "new": new})
            assert answer.status_code == status
        changed = client.post(f"{API}/access/password", json={"old": PASSWORD, "new": "something else"})
        assert changed.status_code == 200
        assert client.get(f"{API}/bench").status_code == 200
        assert other.get(f"{API}/bench").status_code == 401
        assert other.post(f"{API}/access/login", json={"password": PASSWORD}).status_code == 401
        assert other.post(f"{API}/access/login", json={"password": "something else"}).status_code == 200


def test_with_a_damaged_file_nobody_is_let_in_and_the_login_says_why(server: Server) -> None:
    with server.somebody() as client:
        socket = server.socket(f"{API}/events", cookie=f"{SESSION}={client.cookies[SESSION]}")
        (server.folder / FILE).write_text("{}")
        _wait(lambda: client.get(f"{API}/bench").status_code == 503)
        assert _close_code(socket) == NOT_LOGGED_IN
        answer = client.post(f"{API}/access/login", json={"password": PASSWORD})
        assert answer.status_code == 503
        assert FILE in answer.json()["title"]
        assert str(server.folder) not in answer.text
        assert "turnscan password --remove" in answer.json()["hint"]
        assert client.get("/login").status_code == 200
        assert client.get("/", headers={"accept": "text/html"}).headers["location"] == "/login"
        assert client.get("/healthz").status_code == 200


def test_without_a_password_this_machine_is_served_under_its_own_names_only(server: Server) -> None:
    server.access.forget_password()
    bare = TestClient(server.application, base_url="http://localhost")
    assert bare.get(f"{API}/access").json() == {"password_is_set": False, "is_let_in": True, "by": "open"}
    assert bare.get(f"{API}/scans").status_code == 200
    for headers in (
        {"host": "evil.example"}, {"host": "192.168.1.5:8000"}, {"host": ""},
        {"host": "localhost.evil.example"}, {"x-forwarded-for": "192.168.1.5"},
        {"origin": "http://evil.example"}, {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"},
    ):  # fmt: skip
        answer = bare.get(f"{API}/scans", headers=headers)
        assert answer.status_code == 403, headers
        assert "own pages" in answer.json()["title"]
    for address, status in (("192.168.1.5", 403), ("fe80::1", 403), ("::ffff:10.0.0.1", 403), ("::1", 200)):
        client = TestClient(server.application, base_url="http://localhost", client=(address, 1))
        assert client.get(f"{API}/scans").status_code == status, address
    assert bare.post(f"{API}/access/login", json={"password": "anything"}).status_code == 409
    assert bare.post(f"{API}/access/tokens", json={"name": "script"}).status_code == 409
    # The first password may be set from a page, which is logged in by it.
    assert bare.post(f"{API}/access/password", json={"new": PASSWORD}).status_code == 200
    assert bare.get(f"{API}/scans").status_code == 200
    bare.cookies.clear()
    assert bare.get(f"{API}/scans").status_code == 401
    assert bare.get(f"{API}/access", headers={"host": "scanner.example"}).status_code == 200


def test_every_answer_tells_the_browser_what_to_refuse(server: Server) -> None:
    @server.application.get("/surprise")
    def surprise() -> None:
        raise RuntimeError

    with server.somebody() as client:
        paths = (
            "/login",
            "/",
            "/nowhere",
            f"{API}/bench",
            f"{API}/scans/nope",
            "/start/start.js",
            "/healthz",
        )
        inner = TestClient(
            server.application, base_url=server.url, cookies=client.cookies, raise_server_exceptions=False
        )
        answers = [client.get(path) for path in (*paths, "/view/")] + [inner.get("/surprise")]
        assert answers[-1].status_code == 500
        assert "RuntimeError" not in answers[-1].text
        for answer in answers:
            headers = answer.headers
            assert headers["x-content-type-options"] == "nosniff", answer.url
            assert headers["referrer-policy"] == "same-origin"
            assert headers["cross-origin-resource-policy"] == "same-origin"
            assert headers["cross-origin-opener-policy"] == "same-origin"
            assert "camera=()" in headers["permissions-policy"]
            policy = headers["content-security-policy"]
            assert "default-src 'self'" in policy
            assert "frame-ancestors" in policy
            assert "strict-transport-security" not in headers
            assert ("unsafe" in policy) == ("/view/" in str(answer.url))
        assert client.get(f"{API}/bench").headers["cache-control"] == "private, no-cache"
        assert "frame-ancestors 'none'" in client.get("/login").headers["content-security-policy"]


_EVIL_NAMES = (
    "..", "%2e%2e", "..%2f..%2fetc%2fpasswd", "%2fetc%2fpasswd", "..%5c..%5cwindows", "a%00b", "a%0ab",
    ".hidden", "c:%5cx", "x" * 5000, "%ff%fe", "link", "link.json", "~", "%2e", "con", "*",
)  # fmt: skip


def test_no_name_from_a_client_leads_out_of_its_folder(server: Server, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "recording.json").write_text("{}")
    for folder in ("scans", "jobs", "calibration_store"):
        (server.folder / folder).mkdir(exist_ok=True)
        (server.folder / folder / "link").symlink_to(outside)
        (server.folder / folder / "link.json").symlink_to("/etc/passwd")
    before = sorted(str(path) for path in outside.rglob("*"))
    with server.somebody() as client:
        named = [(method, path) for method, path in _routes(server) if "{" in path]
        assert {"/scans/{name}", "/jobs/{job_id}"} <= {path.removeprefix(API) for _, path in named}
        for method, path in named:
            for name in _EVIL_NAMES:
                parts = (name if part.startswith("{") else part for part in path.split("/"))
                answer = client.request(method, "/".join(parts), json={})
                assert 400 <= answer.status_code < 500, (method, path, name, answer.status_code)
        for name in ("../../etc", "/etc", "a\x00b", "..\\x", "x" * 5000, "link", ""):
            for path in ("resume-scan", "reconstruct"):
                answer = client.post(f"{API}/jobs/{path}", json={"scan": name})
                assert 400 <= answer.status_code < 500, (path, name)
    assert sorted(str(path) for path in outside.rglob("*")) == before


def test_a_socket_whose_right_ends_before_it_is_accepted_is_told_so() -> None:
    sent: list[Message] = []

    async def endless(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.Event().wait()

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        sent.append(message)

    asyncio.run(ending_socket(endless, {}, receive, send, lambda: False, SocketEnded(4401, "over")))
    assert [each["type"] for each in sent] == ["websocket.accept", "websocket.close"]


@pytest.mark.parametrize(
    ("accepted", "language"),
    [("", "en"), ("de-AT,de;q=0.9,en;q=0.8", "de"), ("fr, en;q=0.5, de;q=0.4", "en"), ("de;q=x", "en")],
)
def test_the_login_page_speaks_the_browser_s_language(server: Server, accepted: str, language: str) -> None:
    assert language_of(accepted) == language
    with server.stranger(**{"accept-language": accepted}) as stranger:
        page = stranger.get("/login").text
    assert f'<html lang="{language}">' in page
    assert ("Anmelden" in page) == (language == "de")
    assert "$" not in page
    # A strict policy lets nothing in the page itself run.
    assert "<style" not in page
    assert page.count("<script") == 1


def test_every_sentence_of_the_login_page_is_there_in_each_language() -> None:
    from app.api import login_page

    words = json.loads((login_page._FILES / "words.json").read_text())
    assert words["en"].keys() == words["de"].keys()
    assert words["en"]["sentences"].keys() == words["de"]["sentences"].keys()


def test_browsers_are_told_apart() -> None:
    android = "Mozilla/5.0 (Linux; Android 14) AppleWebKit/537 Chrome/120 Mobile Safari/537"
    assert browser_words(android) == "Chrome on Android"
    assert browser_words("python-httpx/1") == "Unknown browser"


def _close_code(socket: Connection) -> int:
    """What a socket that the server ends is told."""
    with socket:
        for _ in _messages(socket):
            pass
    assert socket.close_code is not None
    return socket.close_code


def _messages(socket: Connection) -> Iterator[str | bytes]:
    with contextlib.suppress(ConnectionClosed):
        while True:
            yield socket.recv(timeout=PATIENCE_S)


def _wait(is_so: Callable[[], bool]) -> None:
    ends = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < ends, "it never came to be"
        time.sleep(0.01)
