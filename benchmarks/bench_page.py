"""The page in a browser: how much comes at first, how soon it can be used, and what ten minutes of news cost.

`python -m benchmarks.bench_page --seconds 60` lets the news last as long as wished. The 3D view is a page of
viser's own in a frame, and left out of everything here.
"""

import argparse
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn
from playwright.sync_api import Browser, CDPSession, Page, Route
from rich.console import Console

from app.api.services import Services
from app.devices.bench_file import simulated_description
from app.jobs.events import PointsAdded
from app.jobs.runner import JobContext
from app.main import create_app
from app.settings import Settings
from app.viewer.proxy import SOCKET_OPTIONS
from benchmarks.browser import DESK, chromium
from benchmarks.report import Row, at_most, table_of

_TEN_MINUTES_S = 600.0
_TIMES = 5
_PATIENCE_MS = 120_000
# Each kind of news is passed on ten times a second, so three kinds are thirty.
_TICK_S = 0.1
_MOST_MS = 16.0
_WARM_S = 10.0
_USABLE = """() => {
  const button = document.querySelector("form button[type=submit]");
  return button && !button.disabled ? performance.now() : false;
}"""
# From a piece of news until the page is free again: what it does about it, drawing excepted.
_TIMED = """
window.newsMs = [];
const own = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
Object.defineProperty(WebSocket.prototype, "onmessage", { ...own, set(hear) {
  if (!this.url.endsWith("/events")) return own.set.call(this, hear);
  own.set.call(this, (message) => {
    const began = performance.now(), { port1, port2 } = new MessageChannel();
    port1.onmessage = () => { newsMs.push(performance.now() - began); port1.close(); };
    hear(message);
    port2.postMessage(0);
  });
} });"""


@dataclass(frozen=True, slots=True)
class _News:
    """What listening cost.

    Attributes:
        times_ms: for each piece of news, until the page was free again.
        heap_mb: script's memory after a collection: once it had settled, and at the end.
        nodes: of the documents, at the same moments.
        thread_s: processor time of the page's thread for all of them, drawing included.
        seconds: how long it lasted.
    """

    times_ms: list[float]
    heap_mb: tuple[float, float]
    nodes: tuple[int, int]
    thread_s: float
    seconds: float


def run(seconds: float = _TEN_MINUTES_S) -> list[Row]:
    """Measure.

    Args:
        seconds: how long there are news.
    """
    load = os.getloadavg()[0]
    with (
        tempfile.TemporaryDirectory() as folder,
        _served(Path(folder)) as (services, address),
        chromium() as browser,
    ):
        loads = [_first_load(browser, address) for _ in range(_TIMES)]
        news = _listened(browser, address, services, seconds)
    usable_s = statistics.median(usable for _, usable in loads)
    each_ms = 1e3 * news.thread_s / len(news.times_ms)
    rate = len(news.times_ms) / news.seconds
    slow = sum(each > _MOST_MS for each in news.times_ms)
    late = statistics.quantiles(news.times_ms, n=100)[98]
    what = f"{rate:.0f} pieces of news a second for {news.seconds:.0f} s, load {load:.1f}"
    (heap, later), (nodes, more) = news.heap_mb, news.nodes
    return [
        at_most("first load, gzip, without the 3D view", loads[0][0] / 1e3, "kB", 250.0),
        at_most("until a scan can be started", usable_s, "s", 1.5, f"median of {_TIMES}, load {load:.1f}"),
        at_most("a piece of news, 99 of 100", late, "ms", _MOST_MS, what),
        Row("longest", max(news.times_ms), "ms", note=f"{slow} pieces above {_MOST_MS:g} ms"),
        at_most("processor time for each, with drawing", each_ms, "ms", _MOST_MS, "mean, the page's thread"),
        at_most("memory of its scripts grew", later - heap, "MB", 1.0, f"{heap:.1f} to {later:.1f} MB"),
        at_most("nodes of its document grew", more - nodes, "nodes", 200, f"{nodes} to {more}"),
    ]  # fmt: skip


@contextmanager
def _page(browser: Browser) -> Iterator[tuple[Page, CDPSession]]:
    with browser.new_context(viewport=DESK, locale="en-GB") as context:
        page = context.new_page()
        page.set_default_timeout(_PATIENCE_MS)
        page.route("**/view/*/**", _nothing)
        yield page, context.new_cdp_session(page)


def _nothing(route: Route) -> None:
    route.fulfill(body="<!doctype html><title>view</title>", content_type="text/html")


def _first_load(browser: Browser, address: str) -> tuple[float, float]:
    """Bytes that came, and seconds until a scan could be started."""
    with _page(browser) as (page, session):
        sent: dict[str, str] = {}
        sizes: dict[str, float] = {}

        def request(event: Mapping[str, Any]) -> None:
            sent[event["requestId"]] = event["request"]["url"]

        def loaded(event: Mapping[str, Any]) -> None:
            sizes[event["requestId"]] = event["encodedDataLength"]

        session.on("Network.requestWillBeSent", request)
        session.on("Network.loadingFinished", loaded)
        session.send("Network.enable")
        # From another machine there is no other packing without TLS.
        session.send("Network.setAcceptedEncodings", {"encodings": ["gzip"]})
        page.goto(f"{address}/scan", wait_until="commit")
        usable_ms = page.wait_for_function(_USABLE, polling="raf").json_value()
        page.wait_for_load_state("networkidle")
    size = sum(size for number, size in sizes.items() if "/view/" not in sent.get(number, ""))
    return size, usable_ms / 1e3


def _listened(browser: Browser, address: str, services: Services, seconds: float) -> _News:
    """The scan's page, while a scan tells how it goes."""
    is_over = threading.Event()

    def work(job: JobContext) -> Mapping[str, Any]:
        number = 0
        while not is_over.wait(_TICK_S):
            number += 1
            job.progress(number, round(2.0 * seconds / _TICK_S), "picture")
            job.say(f"picture {number}")
            job.bus.publish(PointsAdded(job.id, 700 * number))
        return {}

    with _page(browser) as (page, session):
        page.add_init_script(_TIMED)
        session.send("Performance.enable")
        page.goto(f"{address}/scan")
        job = services.runner.submit("scan", "News", work, needs_bench=False)
        page.get_by_role("progressbar", name="Progress of the scan").wait_for()
        # Each log is kept up to a length, and code is compiled as it is used.
        page.wait_for_timeout(1e3 * min(_WARM_S + 200 * _TICK_S, seconds))
        before = _measured(session)
        page.evaluate("newsMs = []")
        began_s = time.monotonic()
        page.wait_for_timeout(1e3 * seconds)
        took_s = time.monotonic() - began_s
        times = page.evaluate("newsMs")
        after = _measured(session)
        is_over.set()
    while not services.runner.job(job.id).state.has_ended:
        time.sleep(_TICK_S)
    heap_mb = (before["JSHeapUsedSize"] / 1e6, after["JSHeapUsedSize"] / 1e6)
    thread_s = after["ThreadTime"] - before["ThreadTime"]
    return _News(times, heap_mb, (round(before["Nodes"]), round(after["Nodes"])), thread_s, took_s)


def _measured(session: CDPSession) -> dict[str, float]:
    session.send("HeapProfiler.collectGarbage")
    return {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}


@contextmanager
def _served(folder: Path) -> Iterator[tuple[Services, str]]:
    application = create_app(Settings(folder, "simulated"), simulated_description(width=320, height=240))
    server = uvicorn.Server(uvicorn.Config(application, port=0, log_level="error", **SOCKET_OPTIONS))
    thread = threading.Thread(target=server.run, name="web server")
    thread.start()
    services: Services = application.state.services
    while not (server.started and services.bench.turntable.is_connected):
        time.sleep(0.05)
    try:
        yield services, f"http://localhost:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=_TEN_MINUTES_S, help="how long there are news")
    Console().print(table_of("page", run(parser.parse_args().seconds)))
