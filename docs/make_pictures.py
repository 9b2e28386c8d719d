"""The pictures of the page in the README and in `docs/`, taken by a browser of a simulated scanner at work.

`python -m docs.make_pictures [FOLDER]`; with `--all` also each place at both sizes, light and dark,
into `out/pictures/`, to be looked at.
"""

import argparse
import io
import itertools
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, expect

from benchmarks.browser import DESK, PHONE, chromium
from benchmarks.served import served

Pixels: TypeAlias = NDArray[np.int16]
_PATIENCE_MS = 300_000
_SEEN: Sequence[str] = ("/scan", "/adjust", "/calibrate", "/library", "/settings", "/setup")
_SCHEMES: Sequence[Literal["light", "dark"]] = ("light", "dark")
# Of the animation.
_SHORTEST_S, _LONGEST_S, _LAST_S, _MOST_S = 0.2, 0.6, 2.5, 11.5
_WIDTH = 960
_WISHES = """localStorage["turnscan.scan"] ??= '{"steps": %d}'"""
_STOPS, _FEW_STOPS = 150, 75
# A camera so slow that a scan has as many pictures as its animation needs.
_SLOW_FPS = 2.0
_SMALL_DESK: ViewportSize = {"width": 1120, "height": 700}
_ENOUGH = 0.65
_FAR_ENOUGH = """(enough) => {
  const bar = document.querySelector("main [role=progressbar]");
  return bar && Number(bar.ariaValueNow) >= enough * Number(bar.ariaValueMax);
}"""
# A colour of the cloud: no grey, as nearly all else is.
_COLOURFUL, _CLOUD_PIXELS = 70, 4000
# Grey levels by which a pixel may change where nothing moves, nor comes slowly into sight; how many may more.
_STILL, _MOVING = 6, 0.002
_REST_S, _PATIENCE_S = 1.0, 300.0


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("folder", type=Path, nargs="?", default=Path("docs/pictures"))
    asked.add_argument("--all", action="store_true", help="each place, too, into out/pictures/")
    wanted = asked.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        with _scanner(fps=_SLOW_FPS) as address:
            _in_motion(browser, address, wanted.folder / "scan.webp")
        with _scanner(fps=15.0) as address:
            _at_the_desk(browser, address, wanted.folder)
            _on_the_phone(browser, address, wanted.folder)
            if wanted.all:
                _everywhere(browser, address, Path("out/pictures"))


@contextmanager
def _scanner(fps: float) -> Iterator[str]:
    with (
        tempfile.TemporaryDirectory(prefix="turnscan-pictures-") as kept,
        served(Path(kept), object="mug", fps=fps) as address,
    ):
        yield address


def _in_motion(browser: Browser, address: str, path: Path) -> None:
    """A scan from its start to its end."""
    with _page(browser, viewport=_SMALL_DESK) as page:
        _order(page, address, _FEW_STOPS, "Mug")
        frames = [_shot(page)]
        _start(page)
        finished = page.get_by_role("heading", name="Scan finished")
        while not finished.is_visible():
            frames.append(_shot(page))
        _when_all_is_told(page)
        frames.append(_with_cloud(page))
    _animate(frames, path)


def _at_the_desk(browser: Browser, address: str, folder: Path) -> None:
    """A scan that is finished."""
    with _page(browser, viewport=DESK) as page:
        _order(page, address, _STOPS, "Mug")
        _start(page)
        expect(page.get_by_role("heading", name="Scan finished")).to_be_visible()
        _when_all_is_told(page)
        for scheme in _SCHEMES:
            page.emulate_media(color_scheme=scheme)
            _save(_with_cloud(page), folder / f"desk-{scheme}.webp")


def _on_the_phone(browser: Browser, address: str, folder: Path) -> None:
    """Two thirds of a scan, which then rests and in the end is cancelled."""
    with _page(browser, viewport=PHONE, device_scale_factor=2, has_touch=True) as page:
        _order(page, address, _FEW_STOPS, "Mug, closer")
        _start(page)
        page.wait_for_function(_FAR_ENOUGH, arg=_ENOUGH)
        page.get_by_role("button", name="Pause").click()
        _save(_with_cloud(page), folder / "phone-light.webp")
        page.get_by_role("button", name="Cancel scan").click()
        page.get_by_role("dialog").get_by_role("button", name="Cancel scan").click()
        expect(page.get_by_role("button", name="Cancel scan")).to_have_count(0)


def _order(page: Page, address: str, stops: int, title: str) -> None:
    """The page with a scan that only has to be started."""
    page.add_init_script(_WISHES % stops)
    page.goto(f"{address}/scan")
    page.get_by_role("textbox", name="Name").fill(title)
    page.frame_locator("iframe").locator("canvas").first.wait_for()
    _shot_when(page, _is_steady)


def _start(page: Page) -> None:
    page.get_by_role("button", name="Start scan").click()
    # Nothing shall look as if it were pointed at.
    page.mouse.move(0, 0)


def _when_all_is_told(page: Page) -> None:
    """The picture of the finished scan has come, and the word of its end has gone."""
    expect(page.get_by_role("img", name="from three sides")).to_be_visible()
    expect(page.get_by_role("region", name="Messages").get_by_role("button")).to_have_count(0)


def _everywhere(browser: Browser, address: str, folder: Path) -> None:
    for (size, viewport), scheme in itertools.product({"desk": DESK, "phone": PHONE}.items(), _SCHEMES):
        with _page(browser, viewport=viewport, color_scheme=scheme) as page:
            for path in _SEEN:
                page.goto(f"{address}{path}")
                page.wait_for_load_state("networkidle")
                _save(_shot(page, full_page=True), folder / f"{path.strip('/')}-{size}-{scheme}.webp")


@contextmanager
def _page(browser: Browser, **looks: Any) -> Iterator[Page]:
    with browser.new_context(locale="en-GB", **looks) as context:
        page = context.new_page()
        page.set_default_timeout(_PATIENCE_MS)
        expect.set_options(timeout=_PATIENCE_MS)
        yield page


def _with_cloud(page: Page) -> Image.Image:
    """The page as soon as a cloud is to be seen in it and hardly anything moves any more."""

    def is_there(before: Pixels, now: Pixels) -> bool:
        cloud = int(np.count_nonzero(np.ptp(now, axis=2) > _COLOURFUL))
        return cloud > _CLOUD_PIXELS and _is_steady(before, now)

    return _shot_when(page, is_there)


def _is_steady(before: Pixels, now: Pixels) -> bool:
    return bool(np.mean(np.abs(now - before).max(axis=2) > _STILL) < _MOVING)


def _shot_when(page: Page, is_so: Callable[[Pixels, Pixels], bool]) -> Image.Image:
    """The first picture that is as wanted; judged with the one before it. Raises TimeoutError."""
    ends_s = time.monotonic() + _PATIENCE_S
    before = np.asarray(_shot(page), np.int16)
    while time.monotonic() < ends_s:
        time.sleep(_REST_S)
        picture = _shot(page)
        now = np.asarray(picture, np.int16)
        if is_so(before, now):
            return picture
        before = now
    raise TimeoutError("the page never looked as it should")


def _shot(page: Page, full_page: bool = False) -> Image.Image:
    png = page.screenshot(timeout=_PATIENCE_MS, full_page=full_page)
    return Image.open(io.BytesIO(png)).convert("RGB")


def _animate(frames: Sequence[Image.Image], path: Path) -> None:
    """As many as fit into its time, evenly spread; the last stays longer."""
    room_s = _MOST_S - _LAST_S
    count = min(len(frames), int(room_s / _SHORTEST_S))
    chosen = [frames[round(at)] for at in np.linspace(0, len(frames) - 1, count)]
    height = round(_WIDTH * _SMALL_DESK["height"] / _SMALL_DESK["width"])
    small = [frame.resize((_WIDTH, height), Image.Resampling.LANCZOS) for frame in chosen]
    times_ms = [round(1e3 * min(room_s / count, _LONGEST_S))] * (count - 1) + [round(1e3 * _LAST_S)]
    small[0].save(
        path, save_all=True, append_images=small[1:], duration=times_ms, loop=0, quality=72, method=6
    )
    print(f"{path}: {count} of {len(frames)} pictures, {path.stat().st_size / 1e6:.2f} MB")


def _save(picture: Image.Image, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.save(path, quality=88, method=6)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
