"""Who gets which picture, and what it costs those who do not look."""

import gc
import threading
import time
from collections.abc import Iterator

import pytest
from counted_camera import SIZE, SOON_S, CountedCamera, connected, next_of, taken, wait_until, watched

from app.devices.camera import Camera
from app.devices.frame import Mounting
from app.errors import OptionError
from app.live.known import Known
from app.live.picture import JPEG
from app.live.pictures import LivePictures
from app.live.settings import Kind
from app.recording.picture import decode, inspect

_RED = Known({"left": "red"})


@pytest.fixture
def driver() -> CountedCamera:
    return CountedCamera()


@pytest.fixture
def camera(driver: CountedCamera) -> Iterator[Camera]:
    camera = connected(driver)
    yield camera
    camera.disconnect()


@pytest.fixture
def live(camera: Camera) -> Iterator[LivePictures]:
    with watched(LivePictures(camera, _RED, lit=lambda: ("left",), share=1.0)) as live:
        yield live


def test_with_nobody_watching_no_thread_runs_and_no_frame_is_developed(
    driver: CountedCamera, camera: Camera, live: LivePictures
) -> None:
    with camera.stream() as stream:
        for _, _ in zip(stream, range(20), strict=False):
            pass
    assert driver.developed == []
    assert live_threads() == []
    assert not live.state.is_running


def test_after_the_last_viewer_has_left_nothing_runs_any_more(
    driver: CountedCamera, camera: Camera, live: LivePictures
) -> None:
    with live.watch(Kind.OVERLAY) as viewer:
        assert viewer.next(SOON_S) is not None
        assert live.state.is_running
    wait_until(lambda: live_threads() == [])
    count = len(driver.developed)
    first = camera.fresh_frame()
    wait_until(lambda: camera.fresh_frame().index > first.index + 5)
    assert len(driver.developed) == count


def test_a_viewer_that_never_asks_costs_no_development(
    driver: CountedCamera, camera: Camera, live: LivePictures
) -> None:
    with live.watch(Kind.OVERLAY), live.watch(Kind.RAW, on_ready=lambda: None):
        first = camera.fresh_frame()
        wait_until(lambda: camera.fresh_frame().index > first.index + 10)
        assert driver.developed == []
        assert live.state.made == 0


@pytest.mark.parametrize("kind", list(Kind))
def test_each_frame_is_made_once_however_many_look(
    driver: CountedCamera, live: LivePictures, kind: Kind
) -> None:
    driver.is_held = True
    viewers = [live.watch(kind) for _ in range(5)]
    for viewer in viewers:
        viewer.acknowledge()
    driver.release()
    pictures = [taken(viewer) for viewer in viewers]
    assert len({id(picture) for picture in pictures}) == 1
    assert live.state.made == 1
    assert len(driver.developed) == 1


def test_one_frame_is_developed_once_for_all_kinds(driver: CountedCamera, live: LivePictures) -> None:
    driver.is_held = True
    viewers = [live.watch(kind) for kind in Kind]
    for viewer in viewers:
        viewer.acknowledge()
    driver.release()
    pictures = [taken(viewer) for viewer in viewers]
    assert len(driver.developed) == 1
    assert len({picture.frame_index for picture in pictures}) == 1


def test_a_viewer_that_comes_late_gets_the_picture_that_is_there(
    driver: CountedCamera, live: LivePictures
) -> None:
    driver.is_held = True
    with live.watch(Kind.OVERLAY) as early, live.watch(Kind.OVERLAY) as late:
        early.acknowledge()
        driver.release()
        wait_until(lambda: live.state.made == 1)
        assert late.next(SOON_S) is not None
        assert live.state.made == 1


def test_no_picture_is_shown_twice_and_the_newest_wins(camera: Camera, live: LivePictures) -> None:
    with live.watch(Kind.RAW) as viewer:
        indices = []
        for _ in range(8):
            picture = next_of(viewer)
            indices.append(picture.frame_index)
            wait_until(lambda seen=picture.frame_index: camera.fresh_frame().index > seen + 2)  # type: ignore[misc]
    assert indices == sorted(set(indices))
    assert indices[-1] - indices[0] > 7
    assert viewer.skipped == indices[-1] - indices[0] - 7


def test_a_picture_nobody_fetched_in_time_gives_way_to_a_newer_one(
    driver: CountedCamera, live: LivePictures
) -> None:
    driver.is_held = True
    with live.watch(Kind.RAW) as viewer:
        viewer.acknowledge()
        driver.release()
        wait_until(lambda: live.state.made == 1)
        driver.release(5)
        wait_until(lambda: driver._released == 0)
        picture = viewer.next(SOON_S)
        assert picture is not None
        assert picture.frame_index > 0


def test_a_viewer_that_waits_in_vain_gets_none_and_is_not_worked_for(
    driver: CountedCamera, live: LivePictures
) -> None:
    driver.is_held = True
    with live.watch(Kind.RAW) as viewer:
        assert viewer.next(0.02) is None
        driver.release()
        wait_until(lambda: driver._released == 0)
        with live.watch(Kind.STRIPE) as other:
            other.acknowledge()
            driver.release()
            wait_until(lambda: live.state.made == 1)
        assert live.state.fps[Kind.RAW] == 0.0


def test_a_callback_tells_that_a_picture_waits_and_only_after_an_acknowledgement(
    live: LivePictures,
) -> None:
    ready = threading.Event()
    with live.watch(Kind.STRIPE, on_ready=ready.set) as viewer:
        assert viewer.take() is None
        for _ in range(3):
            viewer.acknowledge()
            assert ready.wait(SOON_S)
            ready.clear()
            assert viewer.take() is not None
            assert viewer.take() is None
        assert not ready.is_set()


def test_a_viewer_whose_callback_fails_is_forgotten_and_the_others_are_not(live: LivePictures) -> None:
    def gone() -> None:
        raise RuntimeError("the event loop is closed")

    with live.watch(Kind.RAW, on_ready=gone) as vanished, live.watch(Kind.RAW) as other:
        vanished.acknowledge()
        wait_until(lambda: not vanished.is_open)
        assert other.next(SOON_S) is not None
        assert live.state.viewers[Kind.RAW] == 1
        assert vanished.next(SOON_S) is None


def test_a_viewer_that_vanishes_without_a_word_is_forgotten(live: LivePictures) -> None:
    viewer = live.watch(Kind.RAW)
    assert viewer.next(SOON_S) is not None
    del viewer
    gc.collect()
    wait_until(lambda: live_threads() == [])
    assert live.state.viewers[Kind.RAW] == 0


def test_closing_a_viewer_wakes_whoever_waits_for_it(driver: CountedCamera, live: LivePictures) -> None:
    driver.is_held = True
    viewer = live.watch(Kind.RAW)
    closer = threading.Timer(0.05, viewer.close)
    closer.start()
    began_s = time.monotonic()
    assert viewer.next(60.0) is None
    assert time.monotonic() - began_s < 30.0
    closer.join()


def test_after_the_end_nobody_gets_anything(live: LivePictures) -> None:
    viewer = live.watch(Kind.RAW)
    live.close()
    assert viewer.next(SOON_S) is None
    assert live.watch(Kind.RAW).next(SOON_S) is None
    assert live_threads() == []


def test_viewers_may_come_and_go_all_the_time(live: LivePictures) -> None:
    problems: list[BaseException] = []

    def come_and_go(kind: Kind) -> None:
        try:
            for _ in range(15):
                with live.watch(kind) as viewer:
                    assert viewer.next(SOON_S) is not None
        except BaseException as error:  # noqa: BLE001
            problems.append(error)

    threads = [threading.Thread(target=come_and_go, args=(kind,)) for kind in (*Kind, *Kind)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    wait_until(lambda: live_threads() == [])


def test_the_cameras_own_jpeg_is_passed_through(
    driver: CountedCamera, camera: Camera, live: LivePictures
) -> None:
    driver.is_held = True
    with live.watch(Kind.RAW) as viewer:
        viewer.acknowledge()
        driver.release()
        wait_until(lambda: live.state.made == 1)
        picture = viewer.next(SOON_S)
        latest = camera.latest()
        assert picture is not None
        assert latest is not None
        assert picture.data is latest.encoded("jpeg")


def test_a_picture_that_is_turned_or_too_wide_or_no_jpeg_is_made_anew() -> None:
    pixels = CountedCamera()
    pixels.gives_jpeg = False
    for driver, mounting, width, size in (
        (CountedCamera(), Mounting(90), None, (240, 320)),
        (CountedCamera(), Mounting(), 200, (240, 180)),
        (CountedCamera(), Mounting(0, True), None, SIZE),
        (pixels, Mounting(), None, SIZE),
    ):
        camera = connected(driver, mounting)
        with watched(LivePictures(camera), camera) as live, live.watch(Kind.RAW, width=width) as viewer:
            picture = viewer.next(SOON_S)
            assert picture is not None
            assert picture.media_type == JPEG
            assert inspect(picture.data).size == size
            assert picture.size == camera.facts.size


def test_phones_with_almost_the_same_width_share_a_picture() -> None:
    driver = CountedCamera()
    camera = connected(driver)
    with watched(LivePictures(camera), camera) as live:
        assert live.watch(Kind.RAW, width=361)._seat.flavour == live.watch(Kind.RAW, width=412)._seat.flavour
        for width in (0, -5, True, 10**6, "wide"):
            with pytest.raises(OptionError, match="width"):
                live.watch(Kind.RAW, width=width)  # type: ignore[arg-type]
        with pytest.raises(OptionError, match="is_packed"):
            live.watch(Kind.RAW, is_packed=True)


def test_settings_change_while_people_look(live: LivePictures) -> None:
    with live.watch(Kind.OVERLAY) as viewer:
        wide = next_of(viewer)
        live.change(width=100, quality=50, detector="centroid")
        next_of(viewer)
        narrow = next_of(viewer)
        assert decode(wide.data, SIZE).shape == (240, 320, 3)
        assert inspect(narrow.data).size == (100, 75)


def test_making_pictures_keeps_to_its_share_of_the_processor(driver: CountedCamera, camera: Camera) -> None:
    driver.fps = 1000.0
    with watched(LivePictures(camera, _RED, lit=lambda: ("left",), share=0.05)) as live:
        with live.watch(Kind.OVERLAY) as viewer:
            viewer.next(SOON_S)
            began_s, made, used_s = time.monotonic(), live.state.made, 0.0
            while time.monotonic() - began_s < 1.0:
                viewer.next(SOON_S)
            took_s = time.monotonic() - began_s
            used_s = 1e-3 * live.state.ms[Kind.OVERLAY] * (live.state.made - made)
        assert used_s / took_s < 0.1


def live_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("live ")]
