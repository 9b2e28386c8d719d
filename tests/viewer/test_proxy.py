"""The page and the socket under /view/: who may come in, what may be said, and what a slow page costs."""

import logging
from collections.abc import Iterator
from pathlib import Path

import httpx2 as httpx
import numpy as np
import pytest
import viser
from served_view import profile, served, socket_to, wait_until, watch
from viser import _messages as viser_messages
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.viewer.cloud_view import CloudView
from app.viewer.page import viewer_page
from app.viewer.upward import LARGEST_BYTES, WELCOME, kind_of


@pytest.fixture(scope="module")
def view() -> Iterator[CloudView]:
    with CloudView() as view:
        yield view


@pytest.fixture(scope="module")
def port(view: CloudView) -> Iterator[int]:
    with served(view) as port:
        yield port


def test_the_page_comes_once_and_again_only_when_it_has_changed(port: int) -> None:
    first = httpx.get(f"http://127.0.0.1:{port}/view/")
    assert first.status_code == 200
    assert first.headers["content-type"].startswith("text/html")
    assert first.headers["content-encoding"] == "gzip"
    assert viser.__version__ in first.headers["etag"]
    assert first.text.count("document.hasFocus = ") == 1
    assert "frame-ancestors 'self'" in first.headers["content-security-policy"]
    plain = httpx.get(f"http://127.0.0.1:{port}/view/tab-1/", headers={"Accept-Encoding": "identity"})
    assert plain.text == first.text
    again = httpx.get(f"http://127.0.0.1:{port}/view/", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert httpx.get(f"http://127.0.0.1:{port}/view/a%20b/").status_code == 404


def test_who_may_not_enter_gets_neither_page_nor_socket(view: CloudView) -> None:
    with served(view, lambda caller: caller.headers.get("cookie") == "pass=1") as port:
        assert httpx.get(f"http://127.0.0.1:{port}/view/").status_code == 401
        with pytest.raises(InvalidStatus):
            socket_to(port)
        with watch(port, additional_headers={"Cookie": "pass=1"}) as viewer:
            wait_until(lambda: viewer.has_replayed)


@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "http://127.0.0.1:1"])
def test_a_page_from_elsewhere_is_refused(port: int, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refusal:
        socket_to(port, origin=origin)
    assert refusal.value.response.status_code == 403


def test_our_own_page_is_let_in(port: int) -> None:
    with watch(port, origin=f"http://127.0.0.1:{port}") as viewer:
        wait_until(lambda: viewer.has_replayed)


def test_an_old_page_is_told_that_it_is_old(port: int) -> None:
    with socket_to(port, dialect="viser-v0.0.1") as socket, pytest.raises(ConnectionClosed) as end:
        socket.recv()
    assert end.value.rcvd is not None
    assert end.value.rcvd.code == 1002


def test_a_socket_that_does_not_speak_visers_dialect_is_refused(port: int) -> None:
    with pytest.raises(InvalidStatus):
        socket_to(port, dialect="chat")


def test_only_known_messages_reach_viser(
    view: CloudView, port: int, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    reached: list[str] = []
    usual = viser_messages.Message.deserialize.__func__  # type: ignore[attr-defined]

    def overheard(kind: type, data: bytes) -> object:
        reached.append(kind_of(data))
        return usual(kind, data)

    monkeypatch.setattr(viser_messages.Message, "deserialize", classmethod(overheard))
    with caplog.at_level(logging.WARNING), watch(port) as viewer:
        viewer.send("ShareUrlRequest")
        viewer.send("FileTransferStartUpload", filename="x")
        viewer.send("LocalStorageGetItemResponseMessage")
        viewer.socket.send("a text")
        viewer.socket.send(b"\xff\xff no message")
        viewer.send("ViewerCameraMessage", pad=b"x" * LARGEST_BYTES)
        viewer.look()
        wait_until(lambda: view.viewers == 1)
    assert reached == ["ViewerCameraMessage"]
    for kind in ("ShareUrlRequest", "FileTransferStartUpload", "(text)", "(unreadable)", "(too large)"):
        assert any(kind in record.message for record in caplog.records)


def test_a_message_that_is_none_costs_nobody_his_view(view: CloudView, port: int) -> None:
    with watch(port) as good:
        wait_until(lambda: good.has_replayed)
        with socket_to(port) as bad:
            for message in (b"", b"\x81\xa4type\x01", b"\x91" * 5000, b"\xc1"):
                bad.send(message)
        good.look()
        wait_until(lambda: view.viewers == 1)


def test_a_viewer_who_leaves_is_forgotten(view: CloudView, port: int) -> None:
    with watch(port, "/view/short") as viewer:
        viewer.look()
        wait_until(lambda: view.viewers == 1)
        assert list(view._tabs.values()) == ["short"]
    wait_until(lambda: view.viewers == 0 and not view._tabs)


def test_a_viewer_who_never_reads_costs_no_memory_and_delays_nobody() -> None:
    profiles, rounds = [profile(number, points=7500) for number in range(40)], 20
    points = sum(map(len, profiles))
    with CloudView() as view, served(view) as port, socket_to(port, max_queue=1), watch(port) as quick:
        wait_until(lambda: quick.has_replayed)

        def scan() -> None:
            view.begin(("left", "right"))
            for one in profiles:
                view.add(one)
            assert view.settle()
            wait_until(lambda: quick.count() == points)

        scan()
        scan()
        resident, received = _resident_bytes(), quick.received
        for _ in range(rounds):
            scan()
        # What the stalled viewer would be owed if nothing were left out: so much that keeping it would show.
        owed = quick.received - received
        assert owed > 30e6
        assert _resident_bytes() - resident < 0.5 * owed


def _resident_bytes() -> int:
    status = Path("/proc/self/status")
    if not status.exists():
        pytest.skip("the system does not tell how much memory a process has")
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) * 1024


def test_what_we_rely_on_inside_viser_is_there() -> None:
    """Read `app/viewer/loopback.py` again when this fails: inner parts change with any version."""
    assert viser.__version__ == "1.1.1"
    with CloudView() as view:
        inner = view._server._websock_server
        handled = {kind.__name__ for kind in inner._incoming_handlers}
        assert not handled & {"ShareUrlRequest", "ShareUrlDisconnect"}
        assert WELCOME - {"ViewerCameraMessage"} <= handled
        assert inner._live_connections == {}
        assert 1 < inner._broadcast_buffer.max_window_size < 10
        assert inner._host == "127.0.0.1"
        assert view.port > 1023
    assert viewer_page().dialect == f"viser-v{viser.__version__}"


def test_viser_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with CloudView() as view, served(view) as port, watch(port) as viewer:
        wait_until(lambda: viewer.has_replayed)
    assert capfd.readouterr().out == ""


def test_points_that_are_not_finite_are_left_out() -> None:
    broken = profile(0)
    broken.cloud.points[::7] = np.nan
    with CloudView() as view, served(view) as port, watch(port) as viewer:
        view.add(broken)
        wait_until(lambda: len(viewer.points()) == 600)
        assert view.problem == ""
