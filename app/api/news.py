"""News for those who listen: how everything stands, then what changes, each thing ten times a second."""

import asyncio
from collections.abc import AsyncGenerator, Callable

from app.api.bench_out import BenchOut, shown_bench
from app.api.news_models import Wire
from app.api.nudge import Nudge
from app.api.traffic import Traffic
from app.devices.bench import Bench
from app.jobs.events import BenchChanged, Counters, Event
from app.jobs.runner import JobRunner
from app.live.pictures import LivePictures

# Between two messages about the same thing.
_REST_S = 0.1
_SILENCE_S = 15.0
_BENCH_S = 0.2
_TICKS_PER_COUNT = 3


class NewsDesk:
    """For the event loop only. Looks after the bench and the counters while somebody listens, and only then.

    Args:
        bench, runner, live, traffic: where news come from.
        cloud_viewers: how many look at the 3D view.
    """

    def __init__(
        self,
        bench: Bench,
        runner: JobRunner,
        live: LivePictures,
        traffic: Traffic,
        cloud_viewers: Callable[[], int] = int,
    ) -> None:
        self._bench, self._runner, self._live, self._traffic = bench, runner, live, traffic
        self._cloud_viewers = cloud_viewers
        self._wire = Wire(bench)
        self._watch: asyncio.Task[None] | None = None
        self._listeners = 0

    async def listen(self) -> AsyncGenerator[list[tuple[int, str]]]:
        """Number and JSON of events, some at a time; an empty list where nothing happened for a while."""
        nudge = Nudge()
        with self._runner.bus.listen(nudge) as listener:
            self._enter()
            try:
                jobs = await asyncio.to_thread(self._runner.jobs)
                yield [self._wire.state(jobs, self.counters())]
                while True:
                    await nudge.wait(_SILENCE_S)
                    yield [self._wire.event(event) for event in listener.take()]
                    await asyncio.sleep(_REST_S)
            finally:
                self._leave()

    def counters(self) -> Counters:
        """As they are now."""
        camera, live = self._bench.camera.state, self._live.state
        viewers = {str(kind): count for kind, count in live.viewers.items()}
        return Counters(
            frames=camera.frames,
            lost=camera.lost,
            fps=round(camera.fps, 1),
            points=self._runner.bus.points,
            viewers=viewers | {"events": self._listeners, "cloud": self._cloud_viewers()},
            live_fps={str(kind): fps for kind, fps in live.fps.items()},
            skipped=live.skipped,
            bytes_sent=sum(self._traffic.bytes_sent.values()),
        )

    def _enter(self) -> None:
        self._listeners += 1
        if self._watch is None:
            self._watch = asyncio.create_task(self._look())

    def _leave(self) -> None:
        self._listeners -= 1
        if not self._listeners and self._watch is not None:
            self._watch.cancel()
            self._watch = None

    async def _look(self) -> None:
        """What nobody publishes, because it changes by itself."""
        said, tick = _steady(shown_bench(self._bench)), 0
        while True:
            await asyncio.sleep(_BENCH_S)
            bench = _steady(shown_bench(self._bench))
            if bench != said:
                said = bench
                self._publish(BenchChanged())
            tick += 1
            if tick % _TICKS_PER_COUNT == 0:
                self._publish(self.counters())

    def _publish(self, event: Event) -> None:
        self._runner.bus.publish(event)


def _steady(bench: BenchOut) -> BenchOut:
    """Without what changes all the time and is among the counters."""
    camera = bench.camera.model_copy(update={"fps": 0.0, "lost": 0})
    return bench.model_copy(update={"camera": camera})
