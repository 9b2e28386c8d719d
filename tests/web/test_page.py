"""The page in a real browser, on a small simulated bench: from a cloud to a file; every place on a phone."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import uvicorn
from browsing import needs_browser, opened
from playwright.sync_api import Browser, expect

from app.devices.bench_file import simulated_description
from app.geometry.cloud import PointCloud
from app.main import create_app
from app.settings import Settings
from app.surface.ply import write_ply
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


def test_a_scan_is_cleaned_made_a_surface_of_and_taken_home_as_stl(
    address: str, browser: Browser, tmp_path: Path
) -> None:
    write_ply(tmp_path / "ball.ply", _ball())
    with opened(browser, viewport=DESK, locale="en-GB") as (page, complaints):
        upload = f"{address}/api/v1/scans/upload?file=ball.ply&title=Ball"
        assert page.request.post(upload, data=(tmp_path / "ball.ply").read_bytes()).ok
        page.goto(f"{address}/library/ball")
        page.get_by_role("link", name="Make it printable").click()
        expect(page.get_by_role("heading", level=1, name="Finish “Ball”")).to_be_visible()
        total = page.get_by_text("points would go")
        expect(total).to_be_visible()
        # Everything is tried at once, taken back, and taken back again.
        tried = total.text_content()
        assert tried is not None
        page.get_by_role("button", name="Table takes").click()
        page.get_by_label("Clearance over the table", exact=True).fill("8")
        expect(total).not_to_have_text(tried)
        complaints.check(page)
        page.get_by_role("button", name="Undo").click()
        expect(total).to_have_text(tried)
        page.get_by_role("button", name="Redo").click()
        expect(total).not_to_have_text(tried)
        page.get_by_label("Use: Table").uncheck()
        page.get_by_role("button", name="Make the surface").click()
        expect(page.get_by_text("Triangles", exact=True)).to_be_visible()
        complaints.check(page)
        with page.expect_download() as download:
            page.get_by_role("link", name="STL").click()
        download.value.save_as(tmp_path / "ball.stl")
        made = trimesh.load_mesh(tmp_path / "ball.stl")
        assert made.is_watertight
        assert made.extents[2] == pytest.approx(28.0, abs=1.0)
        # After a reload all is as it was, and said in German; what was erased goes, whoever leaves at once.
        page.evaluate("""localStorage["turnscan.preferences"] = '{"language": "de"}'""")
        page.reload()
        expect(page.get_by_text("Die Fläche ist geschlossen.")).to_be_visible()
        expect(page.get_by_label("Anwenden: Teller")).not_to_be_checked()
        complaints.check(page)
        page.get_by_role("button", name="Mehr für die Fläche").click()
        page.get_by_role("menuitem", name="Diese Fläche löschen").click()
        expect(page.get_by_text("Dreiecke", exact=True)).to_have_count(0)
        page.goto("about:blank")
        _wait_until(lambda: page.request.get(f"{address}/api/v1/scans/ball/meshes").json() == [])


def _wait_until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + _PATIENCE_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def _ball() -> PointCloud:
    """30 mm across, on the table, its underside not seen."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(6_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 15.0 * normals + [0.0, 0.0, 15.0]
    ones = np.ones(len(points), np.float32)
    cloud = PointCloud(
        points.astype(np.float32), normals.astype(np.float32), np.full((len(points), 3), 120, np.uint8),
        0.02 * ones, np.zeros(len(points), np.uint8), 0.0 * ones, ones, ("left",),
    )  # fmt: skip
    return cloud.select(points[:, 2] > 2.0)


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
        # Where a window covers the page, Stop is above it.
        page.get_by_text("Alle Einstellungen").tap()
        page.get_by_role("button", name="Zeichnen").tap()
        window = page.get_by_role("dialog")
        expect(window.get_by_role("heading", name="Bildausschnitt")).to_be_visible()
        complaints.check(page)
        window.get_by_role("button", name="Stopp").tap()
        expect(window).to_be_hidden()
        expect(page.get_by_text("Die Laser sind aus", exact=False)).to_be_visible()
        assert complaints.heard == []
