"""The page in a real browser, on a small simulated bench: from the start to a file, at a desk and a phone."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from browsing import needs_browser, opened
from playwright.sync_api import Browser, expect

from app.devices.bench_file import simulated_description
from app.main import create_app
from app.settings import Settings
from app.surface.ply_reader import read_ply
from app.viewer.proxy import SOCKET_OPTIONS
from benchmarks.browser import DESK, PHONE, chromium

_PATIENCE_S = 60.0

pytestmark = needs_browser


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    description = simulated_description("horus", object="sphere", width=320, height=240, rate=20.0)
    application = create_app(Settings(tmp_path_factory.mktemp("page"), "simulated"), description)
    server = uvicorn.Server(
        uvicorn.Config(application, port=0, log_level="error", timeout_graceful_shutdown=1, **SOCKET_OPTIONS)
    )
    thread = threading.Thread(target=server.run, name="page server")
    thread.start()
    end_s = time.monotonic() + _PATIENCE_S
    while not server.started:
        assert thread.is_alive(), "the server did not start"
        assert time.monotonic() < end_s, "the server is too slow"
        time.sleep(0.01)
    yield f"http://localhost:{server.servers[0].sockets[0].getsockname()[1]}"
    server.should_exit = True
    thread.join()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


def test_a_scan_is_clicked_through_from_the_start_to_a_file(
    address: str, browser: Browser, tmp_path: Path
) -> None:
    with opened(browser, viewport=DESK, locale="en-GB") as (page, complaints):
        page.goto(address)
        expect(page).to_have_title("Scan – Turnscan")
        expect(page.get_by_text("Ready", exact=True)).to_be_visible()
        complaints.check(page)
        # Long enough that it is not over before it is paused.
        page.get_by_role("button", name="Start scan").click()
        page.get_by_role("button", name="Pause").click()
        expect(page.get_by_role("button", name="Go on")).to_be_visible()
        # A reload in the middle loses nothing.
        page.reload()
        expect(page.get_by_role("button", name="Go on")).to_be_visible()
        complaints.check(page)
        page.get_by_role("button", name="Cancel scan").click()
        page.get_by_role("dialog").get_by_role("button", name="Cancel scan").click()
        expect(page.get_by_role("heading", name="Unfinished scans")).to_be_visible()
        page.get_by_role("button", name="Scan again").click()
        page.get_by_text("All settings").click()
        page.get_by_label("Stops in one turn", exact=True).fill("8")
        complaints.check(page)
        page.get_by_role("button", name="Start scan").click()
        expect(page.get_by_role("heading", name="Scan finished")).to_be_visible()
        complaints.check(page)
        with page.expect_download() as download:
            page.get_by_role("link", name="Download PLY").click()
        download.value.save_as(tmp_path / "scan.ply")
        assert len(read_ply(tmp_path / "scan.ply").points) > 200
        page.get_by_role("button", name="Scan again").click()
        expect(page.get_by_role("button", name="Start scan")).to_be_visible()


def test_every_place_is_in_order_on_a_phone_in_the_dark_in_german(address: str, browser: Browser) -> None:
    phone: dict[str, Any] = {"viewport": PHONE, "locale": "de-DE", "color_scheme": "dark", "has_touch": True}
    with opened(browser, **phone) as (page, complaints):
        page.goto(f"{address}/settings")
        for label in ("Justieren", "Kalibrieren", "Bibliothek", "Optionen", "Scannen"):
            page.get_by_role("navigation").get_by_role("link", name=label).click()
            expect(page).to_have_title(f"{label} – Turnscan")
            expect(page.get_by_role("heading", level=1, name=label)).to_be_attached()
            complaints.check(page)
        # What another page saw of its scan is none of this one's business.
        expect(page.get_by_role("button", name="Scan starten")).to_be_visible()
        page.get_by_role("button", name="Stopp").click()
        expect(page.get_by_text("Die Laser sind aus", exact=False)).to_be_visible()
        assert complaints.heard == []
