"""The view as a browser draws it."""

from pathlib import Path

import cv2
import numpy as np
from headless import PATIENCE_S, Tab, browser, needs_chromium
from numpy.typing import NDArray
from served_view import profile, served, wait_until
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route

from app.simulation.rig import standard_rig
from app.viewer.cloud_view import CloudView


def _coloured(picture: NDArray[np.uint8]) -> int:
    """Pixels that are neither table, grid nor background: those are nearly grey."""
    saturation = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)[:, :, 1]
    value = picture.max(axis=2)
    return int(np.count_nonzero((saturation > 120) & (value > 60)))


def _grown(tab: Tab, above: int) -> NDArray[np.uint8]:
    pictures = [tab.picture()]

    def has_grown() -> bool:
        pictures.append(tab.picture())
        return _coloured(pictures[-1]) > above

    wait_until(has_grown, PATIENCE_S)
    return pictures[-1]


@needs_chromium
def test_the_cloud_grows_before_the_eyes_of_a_browser(tmp_path: Path) -> None:
    with CloudView() as view, served(view) as port, browser(tmp_path / "profile") as tab:
        view.begin(("left", "right"))
        view.set_point_size(1.5)
        tab.open(f"http://127.0.0.1:{port}/view/")
        wait_until(lambda: view.viewers == 1, PATIENCE_S)
        empty = _coloured(tab.picture())
        for number in range(60):
            view.add(profile(number, points=200))
        few = _grown(tab, empty + 400)
        view.show_rig(standard_rig(640, 480).rig)
        for number in range(60, 180):
            view.add(profile(number, points=200))
        view.turn_to(0.5)
        many = _grown(tab, _coloured(few) + 400)
        cv2.imwrite(str(tmp_path / "few.png"), few)
        cv2.imwrite(str(tmp_path / "many.png"), many)
        # Nothing of viser's own panel is to be seen.
        hidden = "[...document.querySelectorAll('.mantine-Paper-root')].every(e => !e.offsetParent)"
        assert tab.evaluate(hidden)


@needs_chromium
def test_a_view_in_a_frame_without_the_focus_comes_back(tmp_path: Path) -> None:
    def frame(_: Request) -> Response:
        return HTMLResponse("<input autofocus><iframe src='/view/framed/' width=640 height=400></iframe>")

    more = [Route("/", frame)]
    with CloudView() as view, served(view, more=more) as port, browser(tmp_path / "profile") as tab:
        tab.open(f"http://127.0.0.1:{port}/")
        wait_until(lambda: view.viewers == 1, PATIENCE_S)
        first = set(view._server.get_clients())
        view._server._websock_server.disconnect_all_clients()
        wait_until(lambda: bool(set(view._server.get_clients()) - first), PATIENCE_S)
