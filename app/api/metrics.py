"""What those who watch over servers are told, in the format of Prometheus."""

import asyncio
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    GCCollector,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from app.api.traffic import Traffic
from app.devices.bench import Bench
from app.jobs.job import JobState
from app.jobs.runner import JobRunner
from app.live.pictures import LivePictures

_LAG_S = 0.5


class LoopLag:
    """How late the event loop is; 0 while nobody measures."""

    def __init__(self) -> None:
        self.lag_s = 0.0

    async def run(self) -> None:
        """Measure until cancelled."""
        while True:
            began_s = time.monotonic()
            await asyncio.sleep(_LAG_S)
            self.lag_s = max(0.0, time.monotonic() - began_s - _LAG_S)


class ScannerMetrics(Collector):
    """Asks everybody for their numbers when it is asked itself; until then it costs nothing.

    Args:
        bench, runner, live, traffic, lag: who knows them.
        cloud_viewers: how many look at the 3D view.
    """

    def __init__(
        self,
        bench: Bench,
        runner: JobRunner,
        live: LivePictures,
        traffic: Traffic,
        lag: LoopLag,
        cloud_viewers: Callable[[], int],
    ) -> None:
        self._bench, self._runner, self._live = bench, runner, live
        self._traffic, self._lag, self._cloud_viewers = traffic, lag, cloud_viewers
        self._ended: Counter[tuple[str, str]] = Counter()
        self._worked_s: defaultdict[str, float] = defaultdict(float)
        self._counted: set[str] = set()

    def collect(self) -> Iterator[Metric]:
        yield from self._of_camera()
        yield from self._of_pictures()
        yield from self._of_jobs()
        burned = _counter("laser_on_seconds", "How long each laser has been on.", "laser")
        for name, seconds in self._bench.burned_s.items():
            burned.add_metric([name], seconds)
        sent = _counter("sent_bytes", "Sent to clients, before encryption.", "way")
        for way, size in self._traffic.bytes_sent.items():
            sent.add_metric([way], size)
        yield from (burned, sent)
        yield _gauge("event_loop_lag_seconds", "How late the event loop was lately.", self._lag.lag_s)

    def _of_camera(self) -> Iterator[Metric]:
        camera = self._bench.camera.state
        yield _gauge("camera_connected", "Whether the camera is there.", camera.is_connected)
        yield _gauge("camera_fps", "Pictures per second lately.", camera.fps)
        for name, words, value in (
            ("camera_frames", "Pictures since the camera was connected.", camera.frames),
            ("camera_lost", "Pictures that came damaged or not at all.", camera.lost),
            ("camera_reopened", "How often the camera went and came back.", camera.reopened),
        ):
            yield CounterMetricFamily(f"turnscan_{name}", words, value=value)

    def _of_pictures(self) -> Iterator[Metric]:
        state = self._live.state
        viewers = GaugeMetricFamily("turnscan_viewers", "Who looks, by what they look at.", labels=["kind"])
        made = _counter("live_pictures", "Live pictures that were made.", "kind")
        for kind, count in state.viewers.items():
            viewers.add_metric([kind], count)
            made.add_metric([kind], state.made_of[kind])
        viewers.add_metric(["cloud"], self._cloud_viewers())
        viewers.add_metric(["events"], self._runner.bus.listeners)
        yield from (viewers, made)

    def _of_jobs(self) -> Iterator[Metric]:
        jobs = self._runner.jobs()
        now = GaugeMetricFamily(
            "turnscan_jobs", "Jobs by state, of those that are remembered.", labels=["state"]
        )
        states = Counter(job.state for job in jobs)
        for state in JobState:
            now.add_metric([state], states[state])
        for job in jobs:
            if job.state.has_ended and job.id not in self._counted:
                self._ended[job.kind, job.state] += 1
                self._worked_s[job.kind] += job.seconds
        self._counted = {job.id for job in jobs if job.state.has_ended}
        ended = CounterMetricFamily("turnscan_jobs_ended", "Jobs that ended.", labels=["kind", "state"])
        for (kind, how), count in self._ended.items():
            ended.add_metric([kind, how], count)
        worked = _counter("job_seconds", "How long jobs that ended have worked.", "kind")
        for kind, seconds in self._worked_s.items():
            worked.add_metric([kind], seconds)
        yield from (now, ended, worked)
        yield _gauge("scan_points", "Points of the scan that runs or ran last.", self._runner.bus.points)


def metrics_route(metrics: ScannerMetrics) -> Route:
    """`/metrics`, with those of the process."""
    registry = CollectorRegistry()
    registry.register(metrics)
    ProcessCollector(registry=registry)
    GCCollector(registry=registry)

    def answer(request: Request) -> Response:
        return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})

    return Route("/metrics", answer, include_in_schema=False)


def _counter(name: str, words: str, label: str) -> CounterMetricFamily:
    return CounterMetricFamily(f"turnscan_{name}", words, labels=[label])


def _gauge(name: str, words: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"turnscan_{name}", words, value=float(value))
