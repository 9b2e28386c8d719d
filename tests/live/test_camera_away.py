"""A camera that is missing, goes and comes back while people look."""

import threading
from collections.abc import Iterator

import pytest
from counted_camera import SIZE, SOON_S, CountedCamera, connected, next_of, wait_until, watched

from app.devices.camera import Camera
from app.live.known import Known
from app.live.picture import LivePicture, unpack
from app.live.pictures import LivePictures
from app.live.settings import Kind
from app.live.viewer import LiveViewer
from app.recording.picture import decode, inspect
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView

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


@pytest.mark.parametrize("kind", [Kind.RAW, Kind.MASK, Kind.OVERLAY])
def test_the_last_picture_is_shown_dimmed_and_says_why(
    driver: CountedCamera, live: LivePictures, kind: Kind
) -> None:
    with live.watch(kind) as viewer:
        fresh = next_of(viewer)
        driver.is_gone = True
        stale = next_stale(viewer)
        assert "unplugged" in stale.problem
        assert live.state.problem == stale.problem
        assert stale.frame_index >= fresh.frame_index
        assert decode(stale.data, SIZE)[:40].mean() < 20.0
        assert viewer.next(0.1) is None


def test_positions_and_masks_are_empty_while_the_camera_is_away(
    driver: CountedCamera, live: LivePictures
) -> None:
    with live.watch(Kind.STRIPE) as stripes, live.watch(Kind.MASK, is_packed=True) as masks:
        assert unpack(next_of(stripes).data).stripes()[0][2].size > 0
        assert unpack(next_of(masks).data).mask().any()
        driver.is_gone = True
        gone = unpack(next_stale(stripes).data)
        assert gone.facts["is_stale"]
        assert gone.facts["problem"]
        assert gone.stripes() == []
        assert not unpack(next_stale(masks).data).mask().any()


def test_pictures_go_on_when_the_camera_is_back(driver: CountedCamera, live: LivePictures) -> None:
    with live.watch(Kind.OVERLAY) as viewer:
        next_of(viewer)
        driver.is_gone = True
        stale = next_stale(viewer)
        driver.is_gone = False
        back = next_of(viewer)
        assert not back.is_stale
        assert back.frame_index > stale.frame_index
        assert live.state.problem == ""


def test_a_newcomer_is_told_too_and_a_camera_that_is_connected_later_is_found(
    driver: CountedCamera,
) -> None:
    camera = Camera(driver, name="counted")
    with watched(LivePictures(camera, _RED), camera) as live, live.watch(Kind.RAW) as viewer:
        never = next_of(viewer)
        assert never.is_stale
        assert never.frame_index == -1
        assert "not connected" in never.problem
        assert inspect(never.data).format == "jpeg"
        with live.watch(Kind.RAW) as newcomer:
            assert next_of(newcomer).problem == never.problem
        camera.connect()
        wait_until(lambda: not next_of(viewer).is_stale)


def test_what_was_seen_before_nobody_looked_is_no_live_picture(
    driver: CountedCamera, live: LivePictures
) -> None:
    with live.watch(Kind.RAW) as viewer:
        next_of(viewer)
    driver.is_held = True
    with live.watch(Kind.RAW) as viewer:
        driver.release(10)
        first = viewer.next(0.3)
        assert first is None or not first.is_stale
        while (picture := viewer.next(0.1)) is not None and not picture.is_stale:
            pass


def test_a_damaged_picture_is_left_out(driver: CountedCamera, live: LivePictures) -> None:
    with live.watch(Kind.OVERLAY) as viewer:
        next_of(viewer)
        driver.damage = b"\xff\xd8 this is no picture"
        wait_until(lambda: viewer.next(0.1) is None)
        driver.damage = None
        assert not next_of(viewer).is_stale


class _Broken:
    def detect(self, view: LaserView) -> LaserStripe:
        raise ZeroDivisionError("a mistake")

    def detect_several(self, view: LaserView, count: int) -> list[LaserStripe]:
        raise ZeroDivisionError("a mistake")


def test_a_detector_that_breaks_is_named_in_the_picture_and_another_one_helps(
    live: LivePictures, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = STRIPE_DETECTORS.maker
    monkeypatch.setattr(STRIPE_DETECTORS, "maker", lambda name: _Broken if name == "centroid" else own(name))
    live.change(detector="centroid")
    with live.watch(Kind.OVERLAY) as viewer, live.watch(Kind.RAW) as other:
        assert "a mistake" in next_of(viewer).problem
        assert not next_of(other).is_stale
        live.change(detector="zero-crossing")
        wait_until(lambda: not next_of(viewer).is_stale)


def test_a_bench_that_cannot_tell_its_lasers_is_no_end_of_the_pictures(camera: Camera) -> None:
    fails = threading.Event()
    fails.set()

    def lit() -> tuple[str, ...]:
        if fails.is_set():
            raise ZeroDivisionError("a mistake")
        return ()

    with watched(LivePictures(camera, _RED, lit=lit)) as live, live.watch(Kind.RAW) as viewer:
        assert "a mistake" in next_stale(viewer).problem
        fails.clear()
        wait_until(lambda: not next_of(viewer).is_stale)


def test_a_camera_whose_pictures_cannot_be_made_is_told_of(
    driver: CountedCamera, live: LivePictures, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(number: int) -> None:
        raise ZeroDivisionError("a mistake")

    with monkeypatch.context() as patch:
        patch.setattr("counted_camera.stripe_picture", broken)
        with live.watch(Kind.STRIPE) as viewer:
            assert "a mistake" in next_stale(viewer).problem
            patch.undo()
            wait_until(lambda: not next_of(viewer).is_stale)


def test_a_camera_that_is_let_go_wakes_nobody_for_ever(camera: Camera, live: LivePictures) -> None:
    with live.watch(Kind.RAW) as viewer:
        next_of(viewer)
        closer = threading.Timer(0.05, camera.disconnect)
        closer.start()
        assert "not connected" in next_stale(viewer).problem
        closer.join()


def next_stale(viewer: LiveViewer) -> LivePicture:
    """The picture that says that there is none."""
    found: list[LivePicture] = []

    def is_told() -> bool:
        picture = viewer.next(SOON_S)
        if picture is not None and picture.is_stale:
            found.append(picture)
        return bool(found)

    wait_until(is_told)
    return found[0]
