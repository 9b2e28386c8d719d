"""Live pictures while the bench works: board and markers are found, and the scan gets every picture."""

import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from counted_camera import SOON_S, next_of, wait_until, watched

from app.devices.bench import Bench
from app.devices.bench_file import simulated_description
from app.live.picture import unpack
from app.live.pictures import LivePictures
from app.live.settings import Kind
from app.recording.manifest import FrameEntry
from app.recording.manifest_facts import PlatterFacts
from app.scanning.plan import ScanPlan
from app.scanning.run import run_scan
from app.scanning.scan import Taken
from app.scanning.session import ScanSession
from app.vision.board import BoardObservation


class _Watch:
    """Notes what a scan tells."""

    def __init__(self) -> None:
        self.taken_count = 0

    def taken(self, taken: Taken, entry: FrameEntry) -> None:
        self.taken_count += 1

    def waiting(self, problem: str) -> None:
        raise AssertionError(problem)

    def going_on(self) -> None:
        """Never reached: waiting raises."""


def test_viewers_that_never_read_neither_delay_a_scan_nor_fill_the_memory(tmp_path: Path) -> None:
    plan = ScanPlan(lasers=("left", "right"), steps=12)
    with bench_of(rate=4.0) as bench, watched(LivePictures.of_bench(bench)) as live:
        session = ScanSession.create(tmp_path / "scan", plan, bench, "simulated")
        never = [live.watch(kind, on_ready=lambda: None) for kind in Kind]
        for viewer in never:
            # One picture each lies there, never to be fetched.
            viewer.acknowledge()
        wait_until(lambda: live.state.made >= len(Kind))
        made = live.state.made
        seen, is_over = list[int](), threading.Event()

        def look() -> None:
            with live.watch(Kind.OVERLAY, width=320) as viewer:
                while not is_over.is_set():
                    picture = viewer.next(0.2)
                    if picture is not None:
                        seen.append(picture.frame_index)

        lively = threading.Thread(target=look)
        lively.start()
        tracemalloc.start()
        before, _ = tracemalloc.get_traced_memory()
        watch = _Watch()
        try:
            run_scan(bench, session, watch)
            after, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
            is_over.set()
            lively.join()
        assert watch.taken_count == plan.shots
        assert seen
        assert seen == sorted(set(seen))
        # Only the lively one was worked for.
        assert live.state.made - made <= len(seen) + 1
        # A handful of frames with their pixels, however many were taken.
        assert after - before < 40 * 640 * 480 * 3


def test_stripes_of_the_lasers_that_are_lit_come_by_name() -> None:
    with bench_of() as bench:
        assert bench.world is not None
        with (
            watched(LivePictures.of_bench(bench, bench.world.rig)) as live,
            live.watch(Kind.STRIPE) as viewer,
            bench.lit("left", "right"),
        ):
            wait_until(lambda: names_in(next_of(viewer).data) == {"left", "right"})


def test_the_board_and_the_markers_are_found_and_painted() -> None:
    with bench_of(has_platter=True) as bench:
        world = bench.world
        assert world is not None
        with watched(LivePictures.of_bench(bench, world.rig)) as live, live.watch(Kind.OVERLAY) as viewer:
            live.learn(board=world.stage.board)
            world.put("board-on-table")
            wait_until(lambda: not next_of(viewer).is_stale and marks(live, "board") > 10)
            assert marks(live, "markers") > 0
            live.change(shows_board=False)
            assert marks(live, "board") == 0
            live.change(shows_board=True)
            world.put("nothing")
            wait_until(lambda: not next_of(viewer).is_stale and marks(live, "markers") == 8)
            assert marks(live, "board") == 0


def test_a_search_that_takes_long_holds_up_no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()

    def slow(*_: object) -> BoardObservation:
        go_on.wait(SOON_S)
        return BoardObservation.empty()

    monkeypatch.setattr("app.live.search.detect_board", slow)
    with bench_of() as bench, watched(LivePictures.of_bench(bench)) as live:
        assert bench.world is not None
        live.learn(board=bench.world.stage.board)
        with live.watch(Kind.OVERLAY) as viewer:
            for _ in range(5):
                next_of(viewer)
            assert not go_on.is_set()
        go_on.set()


@contextmanager
def bench_of(*, has_platter: bool = False, rate: float = 1.0) -> Iterator[Bench]:
    """A small one, connected."""
    description = simulated_description(width=640, height=480, rate=rate)
    if has_platter:
        markers = PlatterFacts(kind="aruco", dictionary="DICT_4X4_50", marker_mm=16.0, ids=tuple(range(8)))
        description = description.model_copy(update={"platter": markers})
    with Bench.build(description) as bench:
        bench.connect()
        yield bench


def names_in(message: bytes) -> set[str]:
    return {laser for laser, _, pixels, _ in unpack(message).stripes() if len(pixels) > 50}


def marks(live: LivePictures, what: str) -> int:
    """How many corners or markers were found lately."""
    found = getattr(live._darkroom.search.found(live.settings), what)
    return 0 if found is None else len(found.ids)
