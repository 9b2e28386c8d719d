"""A real browser for tests of the page, and all that it holds against what it is shown."""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Error,
    Page,
    Route,
    expect,
)

from app.api.pages import BUILT
from benchmarks.browser import CHROMIUM

_AXE = Path(__file__).resolve().parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
_PATIENCE_MS = 120_000
# A library of viser's tries what its policy forbids, and does without.
_VIEWERS_OWN = "Evaluating a string as JavaScript"
# What a browser says of every request to a server that is not there.
_OF_A_LOST_SERVER = ("ERR_CONNECTION", "ERR_EMPTY_RESPONSE", "WebSocket connection to")

needs_browser = [
    pytest.mark.skipif(not CHROMIUM.exists(), reason=f"there is no browser at {CHROMIUM}"),
    pytest.mark.skipif(not (BUILT / "index.html").exists(), reason="the pages were not built: make pages"),
    pytest.mark.skipif(not _AXE.exists(), reason="axe-core is not installed: cd web && npm ci"),
]


@dataclass
class Complaints:
    """What the browser holds against a page.

    Attributes:
        server_may_die: whether what a browser says of a server that is not there is nobody's fault.
    """

    server_may_die: bool = False
    heard: list[str] = field(default_factory=list)

    def listen_to(self, page: Page) -> None:
        page.on("console", self._console)
        page.on("pageerror", self._error)

    def check(self, page: Page) -> None:
        """Nothing was heard, axe finds nothing to say against what is shown, and it is not too wide."""
        page.evaluate(_AXE.read_text("utf-8"))
        found = page.evaluate("axe.run(document, { iframes: false }).then((said) => said.violations)")
        told = [f"{each['id']}: {json.dumps([node['html'] for node in each['nodes']])}" for each in found]
        assert told == []
        assert page.viewport_size is not None
        assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"], page.url
        assert self.heard == []

    def _console(self, message: ConsoleMessage) -> None:
        if message.type != "error" or "/view/" in message.location["url"]:
            return
        if not (self.server_may_die and any(sign in message.text for sign in _OF_A_LOST_SERVER)):
            self.heard.append(message.text)

    def _error(self, error: Error) -> None:
        if _VIEWERS_OWN not in error.message:
            self.heard.append(error.message)


@contextlib.contextmanager
def opened(
    browser: Browser, server_may_die: bool = False, **context: Any
) -> Iterator[tuple[Page, Complaints]]:
    """A page without the 3D view, which is looked at elsewhere and is slow to draw in software.

    Args:
        browser: as `chromium` gives it.
        server_may_die: whether it is part of the test.
        context: how it looks at things, as `Browser.new_context` takes it.
    """
    with browser.new_context(**context) as looking:
        complaints = Complaints(server_may_die)
        yield _page(looking, complaints), complaints


def _page(context: BrowserContext, complaints: Complaints) -> Page:
    page = context.new_page()
    complaints.listen_to(page)
    page.set_default_timeout(_PATIENCE_MS)
    expect.set_options(timeout=_PATIENCE_MS)
    page.route("**/view/*/**", _nothing)
    return page


def _nothing(route: Route) -> None:
    route.fulfill(body="<!doctype html><title>view</title>", content_type="text/html")
