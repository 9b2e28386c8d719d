"""The page in a real browser, on a small simulated bench: from the start to a file, at a desk and a phone."""

import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import uvicorn
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Error,
    Page,
    Route,
    ViewportSize,
    expect,
    sync_playwright,
)

from app.api.pages import BUILT
from app.devices.bench_file import simulated_description
from app.main import create_app
from app.settings import Settings
from app.surface.ply_reader import read_ply
from app.viewer.proxy import SOCKET_OPTIONS

_CHROMIUM = Path("/usr/bin/chromium")
_AXE = Path(__file__).resolve().parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
_ARGUMENTS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic",
    "--no-first-run",
]  # fmt: skip
_PATIENCE_MS = 90_000
_PATIENCE_S = 60.0
_DESK: ViewportSize = {"width": 1440, "height": 900}
_PHONE: ViewportSize = {"width": 390, "height": 844}
# A library of viser's tries what its policy forbids, and does without.
_VIEWERS_OWN = "Evaluating a string as JavaScript"

pytestmark = [
    pytest.mark.skipif(not _CHROMIUM.exists(), reason=f"there is no browser at {_CHROMIUM}"),
    pytest.mark.skipif(not (BUILT / "index.html").exists(), reason="the pages were not built: make pages"),
    pytest.mark.skipif(not _AXE.exists(), reason="axe-core is not installed: cd web && npm ci"),
]


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
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=_CHROMIUM, args=_ARGUMENTS)
        yield chromium
        chromium.close()


@dataclass
class Complaints:
    """What the browser holds against a page."""

    heard: list[str] = field(default_factory=list)

    def listen_to(self, page: Page) -> None:
        page.on("console", self._console)
        page.on("pageerror", self._error)

    def check(self, page: Page) -> None:
        """Nothing was heard, and axe finds nothing to say against what is shown."""
        page.evaluate(_AXE.read_text("utf-8"))
        found = page.evaluate("axe.run(document, { iframes: false }).then((said) => said.violations)")
        told = [f"{each['id']}: {json.dumps([node['html'] for node in each['nodes']])}" for each in found]
        assert told == []
        assert self.heard == []

    def _console(self, message: ConsoleMessage) -> None:
        if message.type == "error" and "/view/" not in message.location["url"]:
            self.heard.append(message.text)

    def _error(self, error: Error) -> None:
        if _VIEWERS_OWN not in error.message:
            self.heard.append(error.message)


def _opened(context: BrowserContext, complaints: Complaints) -> Page:
    """A page without the 3D view, which is looked at elsewhere and is slow to draw in software."""
    page = context.new_page()
    complaints.listen_to(page)
    page.set_default_timeout(_PATIENCE_MS)
    expect.set_options(timeout=_PATIENCE_MS)
    page.route("**/view/*/**", _nothing)
    return page


def _nothing(route: Route) -> None:
    route.fulfill(body="<!doctype html><title>view</title>", content_type="text/html")


def test_a_scan_is_clicked_through_from_the_start_to_a_file(
    address: str, browser: Browser, tmp_path: Path
) -> None:
    with browser.new_context(viewport=_DESK, locale="en-GB") as context:
        complaints = Complaints()
        page = _opened(context, complaints)
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
    with browser.new_context(viewport=_PHONE, locale="de-DE", color_scheme="dark", has_touch=True) as context:
        complaints = Complaints()
        page = _opened(context, complaints)
        page.goto(f"{address}/settings")
        for label in ("Justieren", "Kalibrieren", "Bibliothek", "Optionen", "Scannen"):
            page.get_by_role("navigation").get_by_role("link", name=label).click()
            expect(page).to_have_title(f"{label} – Turnscan")
            expect(page.get_by_role("heading", level=1, name=label)).to_be_attached()
            assert page.evaluate("document.documentElement.scrollWidth") <= _PHONE["width"], label
            complaints.check(page)
        # What another page saw of its scan is none of this one's business.
        expect(page.get_by_role("button", name="Scan starten")).to_be_visible()
        page.get_by_role("button", name="Stopp").click()
        expect(page.get_by_text("Die Laser sind aus", exact=False)).to_be_visible()
        assert complaints.heard == []
