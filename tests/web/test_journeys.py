"""The whole journey in a real browser with a real server: from nothing to a file, whatever happens."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browsing import Complaints, needs_browser, opened
from mortal_server import MortalServer
from playwright.sync_api import Browser, Page, expect

from app.surface.ply_reader import read_ply
from benchmarks.browser import DESK, PHONE, chromium

pytestmark = needs_browser

_SMALL: dict[str, str | float] = {"object": "sphere", "width": 480, "height": 360}
_MOST_CLICKS = 12
_COUNT = """addEventListener("click", (event) => {
  // The click that a label passes on to its field is not another one.
  if (event.isTrusted && event.detail) sessionStorage.clicks = Number(sessionStorage.clicks ?? 0) + 1;
}, true);"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def server(tmp_path: Path) -> Iterator[MortalServer]:
    server = MortalServer(tmp_path)
    yield server
    server.kill()


def test_whoever_knows_nothing_gets_to_a_calibrated_scan_in_a_few_clicks(
    server: MortalServer, browser: Browser, tmp_path: Path
) -> None:
    server.start(**_SMALL, rate=8.0, fps=5.0)
    with opened(browser, viewport=DESK, locale="en-GB") as (page, complaints):
        page.add_init_script(_COUNT)
        # A draft is enough here.
        page.add_init_script("""localStorage["turnscan.scan"] ??= '{"steps": 10}'""")
        page.goto(server.address)
        expect(page.get_by_text("Ready", exact=True)).to_be_visible()
        page.get_by_role("navigation").get_by_role("link", name="Calibrate").click()
        automatic = page.get_by_role("link", name="Automatic Recommended")
        expect(automatic).to_be_visible()
        complaints.check(page)
        automatic.click()
        begin = page.get_by_role("button", name="Start calibrating")
        expect(begin).to_be_enabled()
        complaints.check(page)
        begin.click()
        expect(page.get_by_role("heading", name="Taking pictures from several angles")).to_be_visible()
        complaints.check(page)
        expect(page.get_by_role("heading", name="The proof", exact=True)).to_be_visible()
        complaints.check(page)
        page.get_by_role("link", name="Scan now").click()
        page.get_by_role("button", name="Start scan").click()
        expect(page.get_by_role("heading", name="Scan finished")).to_be_visible()
        finish = page.get_by_role("link", name="Make it printable")
        assert str(finish.get_attribute("href")).endswith("/finish")
        assert _downloaded(page, "Download PLY", tmp_path) > 500
        assert 5 <= page.evaluate("Number(sessionStorage.clicks)") <= _MOST_CLICKS
        for place in ("Adjust", "Library", "Settings"):
            _go(page, place)
            complaints.check(page)


def test_a_scan_outlives_a_reload_and_the_death_of_its_server(
    server: MortalServer, browser: Browser, tmp_path: Path
) -> None:
    server.start(**_SMALL, rate=4.0, fps=8.0)
    dark: dict[str, Any] = {"viewport": DESK, "locale": "en-GB", "color_scheme": "dark"}
    with opened(browser, server_may_die=True, **dark) as (page, complaints):
        page.add_init_script("""localStorage["turnscan.scan"] ??= '{"steps": 40, "without": ["right"]}'""")
        page.goto(server.address)
        page.get_by_role("button", name="Start scan").click()
        progress = page.get_by_role("progressbar", name="Progress of the scan")
        # Where no picture was taken yet there is nothing to go on with.
        expect(progress).to_have_attribute("aria-valuenow", re.compile("[1-9]"))
        page.get_by_role("button", name="Pause").click()
        go_on = page.get_by_role("button", name="Go on")
        expect(go_on).to_be_visible()
        page.reload()
        expect(progress).to_be_visible()
        page.evaluate("document.body.dataset.same = 'page'")
        go_on.click()
        expect(page.get_by_role("button", name="Pause")).to_be_enabled()
        server.kill()
        expect(page.get_by_text("The server does not answer. Waiting for it", exact=False)).to_be_visible()
        complaints.check(page)
        server.start(**_SMALL, rate=20.0, fps=5.0)
        expect(page.get_by_text("Ready", exact=True)).to_be_visible()
        expect(page.get_by_role("heading", name="Unfinished scans")).to_be_visible()
        complaints.check(page)
        go_on.click()
        expect(page.get_by_role("heading", name="Scan finished")).to_be_visible()
        assert page.evaluate("document.body.dataset.same") == "page"
        assert _downloaded(page, "Download PLY", tmp_path) > 500
        complaints.check(page)


def test_a_steady_turn_and_a_set_up_succeed_on_a_phone_in_the_dark_in_german(
    server: MortalServer, browser: Browser, tmp_path: Path
) -> None:
    # A table that turns steadily is timed, so this one's time is ours.
    server.start(**_SMALL, rate=1.0, fps=10.0)
    phone: dict[str, Any] = {"viewport": PHONE, "locale": "de-DE", "color_scheme": "dark", "has_touch": True}
    with opened(browser, **phone) as (page, complaints):
        page.goto(server.address)
        page.get_by_text("Alle Einstellungen").click()
        page.get_by_text("Stetig", exact=True).click()
        page.get_by_label("Zeit je Umdrehung", exact=True).fill("6")
        complaints.check(page)
        page.get_by_role("button", name="Scan starten").click()
        expect(page.get_by_role("heading", name="Scan fertig")).to_be_visible()
        assert _downloaded(page, "PLY herunterladen", tmp_path) > 500
        complaints.check(page)
        _try_out(page, complaints)


def _try_out(page: Page, complaints: Complaints) -> None:
    """Each device with a tap, and another bench from the list."""
    _go(page, "Optionen")
    page.get_by_role("link", name="Scanner", exact=True).click()
    page.get_by_role("button", name="Um 10° drehen").click()
    page.get_by_role("link", name="Anderen Scanner einrichten").click()
    page.get_by_text("Simulierter Scanner", exact=True).click()
    complaints.check(page)
    page.get_by_role("button", name="Speichern und verbinden").click()
    expect(page.get_by_text("Gespeichert und verbunden.")).to_be_visible()
    complaints.check(page)


def _go(page: Page, place: str) -> None:
    page.get_by_role("navigation").get_by_role("link", name=place).click()
    expect(page.get_by_role("heading", level=1, name=place)).to_be_attached()


def _downloaded(page: Page, link: str, folder: Path) -> int:
    """How many points a file has, taken as a person would."""
    with page.expect_download() as download:
        page.get_by_role("link", name=link).click()
    download.value.save_as(folder / "scan.ply")
    return len(read_ply(folder / "scan.ply").points)
