"""The thread that keeps a camera: fresh frames, streams, settings, and cameras that freeze or vanish."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from camera_contract import CameraContract
from scripted_camera import SIZE, ScriptedCamera, jpeg_picture, noise_picture

from app.devices.camera import Camera, CameraSettings
from app.devices.camera_driver import CameraDriver, ControlName, RawFrame
from app.devices.frame import Use
from app.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from app.recording.picture import decode, inspect

_SOON_S = 60.0
_EXPOSURE, _GAIN, _FOCUS = ControlName.EXPOSURE, ControlName.GAIN, ControlName.FOCUS


class TestScripted(CameraContract):
    @pytest.fixture
    def unplugged(self) -> CameraDriver:
        self.scripted = ScriptedCamera()
        return self.scripted

    def vanish(self) -> None:
        self.scripted.is_gone = True

    def come_back(self) -> None:
        self.scripted.is_gone = False


@pytest.fixture
def scripted() -> ScriptedCamera:
    return ScriptedCamera()


@pytest.fixture
def camera(scripted: ScriptedCamera) -> Iterator[Camera]:
    camera = Camera(scripted)
    camera.connect()
    yield camera
    camera.disconnect()


def test_a_fresh_frame_leaves_out_those_that_are_under_way() -> None:
    scripted = ScriptedCamera(fps=100.0, is_timed=True, delay_s=0.12)
    with connected(Camera(scripted)) as camera:
        wait_until(lambda: camera.latest() is not None)
        asked_s = time.monotonic()
        frame = camera.fresh_frame()
        assert frame.exposed_s >= asked_s
        assert frame.arrived_s >= asked_s + 0.12


def test_without_timestamps_the_measured_latency_tells_what_is_fresh() -> None:
    scripted = ScriptedCamera(fps=100.0, delay_s=0.12)
    with connected(Camera(scripted, latency_s=0.12)) as camera:
        wait_until(lambda: camera.latest() is not None)
        asked_s = time.monotonic()
        frame = camera.fresh_frame()
        assert frame.exposed_s >= asked_s
        true_s = [exposed_s for exposed_s, _ in scripted.exposures]
        assert true_s[frame.index] >= asked_s


def test_a_fresh_frame_of_an_earlier_time_may_be_there_already(camera: Camera) -> None:
    before_s = time.monotonic()
    first = camera.fresh_frame()
    assert camera.fresh_frame(after_s=before_s, timeout_s=0.0).index >= first.index


def test_a_stream_gives_every_frame_in_order(camera: Camera, scripted: ScriptedCamera) -> None:
    with camera.stream() as stream:
        indices = [frame.index for frame, _ in zip(stream, range(40), strict=False)]
    assert indices == list(range(indices[0], indices[0] + 40))
    assert stream.lost == 0


def test_a_slow_reader_loses_the_oldest_frames_and_is_told_how_many(camera: Camera) -> None:
    with camera.stream(most=4) as stream:
        wait_until(lambda: stream.lost >= 3)
        camera.disconnect()
        kept = [frame.index for frame in stream]
    assert kept == list(range(kept[0], kept[0] + 4))


def test_a_stream_ends_when_another_thread_lets_go_of_the_camera(camera: Camera) -> None:
    closer = threading.Timer(0.05, camera.disconnect)
    closer.start()
    with camera.stream() as stream:
        count = sum(1 for _ in stream)
    closer.join()
    assert count > 0


def test_two_readers_get_the_same_frames(camera: Camera) -> None:
    with camera.stream() as one, camera.stream() as other:
        later = next(other)
        assert any(frame is later for frame, _ in zip(one, range(100), strict=False))


@pytest.mark.parametrize("fault", ["is_frozen", "is_stuck", "is_gone"])
def test_a_camera_that_stops_is_noticed_within_a_second_and_opened_again(
    camera: Camera, scripted: ScriptedCamera, fault: str
) -> None:
    camera.fresh_frame()
    camera.set_control(_EXPOSURE, 500.0)
    setattr(scripted, fault, True)
    failed_s = time.monotonic()
    wait_until(lambda: not camera.state.is_connected or camera.state.is_frozen)
    # The bound is for a busy machine.
    assert time.monotonic() - failed_s < 3.0
    wait_until(lambda: bool(camera.state.last_error))
    setattr(scripted, fault, False)
    frame = camera.fresh_frame()
    state = camera.state
    assert frame.arrived_s > failed_s
    assert state.is_connected
    assert not state.is_frozen
    assert state.reopened >= 1
    assert scripted.written[-1] == (_EXPOSURE, 500.0)


def test_a_stream_goes_on_when_the_camera_is_back(camera: Camera, scripted: ScriptedCamera) -> None:
    with camera.stream() as stream:
        first = next(stream)
        scripted.is_gone = True
        wait_until(lambda: not camera.state.is_connected)
        scripted.is_gone = False
        indices = [frame.index for frame, _ in zip(stream, range(50), strict=False)]
    assert indices == list(range(first.index + 1, first.index + 51))


def test_an_impatient_reader_is_told_that_the_camera_has_gone(
    camera: Camera, scripted: ScriptedCamera
) -> None:
    with camera.stream(patience_s=0.1) as stream:
        next(stream)
        scripted.is_gone = True
        with pytest.raises(DeviceLost, match="has gone"):
            for _ in stream:
                pass


def test_waiting_for_a_camera_that_stays_away_ends_in_a_sentence(
    camera: Camera, scripted: ScriptedCamera
) -> None:
    scripted.is_gone = True
    wait_until(lambda: not camera.state.is_connected)
    with pytest.raises(DeviceLost, match=r"camera: has gone and did not come back \(is "):
        camera.fresh_frame(timeout_s=0.05)
    with pytest.raises(DeviceLost):
        camera.controls()


def test_a_camera_that_is_late_is_no_lost_one(camera: Camera, scripted: ScriptedCamera) -> None:
    scripted.is_frozen = True
    with pytest.raises(DeviceTimeout, match="a fresh frame"):
        camera.fresh_frame(timeout_s=0.05)


def test_a_driver_that_breaks_is_opened_again(camera: Camera, scripted: ScriptedCamera) -> None:
    scripted.breaks_with = ZeroDivisionError("no pixels")
    wait_until(lambda: camera.state.reopened == 1)
    assert "no pixels" in camera.state.last_error
    camera.fresh_frame()


def test_a_camera_that_comes_back_with_another_size_is_refused_until_it_has_the_right_one(
    camera: Camera, scripted: ScriptedCamera
) -> None:
    scripted.size = (32, 24)
    scripted.is_gone = True
    wait_until(lambda: not camera.state.is_connected)
    scripted.is_gone = False
    wait_until(lambda: "32 x 24 pixels instead of 64 x 48" in camera.state.last_error)
    scripted.size = SIZE
    assert camera.fresh_frame().size == SIZE


def test_a_control_that_is_set_while_the_camera_is_away_is_written_when_it_is_back(
    camera: Camera, scripted: ScriptedCamera
) -> None:
    scripted.is_gone = True
    wait_until(lambda: not camera.state.is_connected)
    with pytest.raises(DeviceLost):
        camera.set_control(_GAIN, 3.0)
    scripted.is_gone = False
    wait_until(lambda: (_GAIN, 3.0) in scripted.written)


def test_a_value_that_is_refused_is_not_asked_for_again(camera: Camera, scripted: ScriptedCamera) -> None:
    camera.set_control(_GAIN, 2.0)
    with pytest.raises(DeviceError, match="cannot do that"):
        camera.set_control(_GAIN, 1e9)
    with pytest.raises(DeviceRefused):
        camera.set_control(_FOCUS, 1.0)
    reopen(camera, scripted)
    assert scripted.written == [(_GAIN, 2.0), (_GAIN, 2.0)]


def test_damaged_pictures_are_counted_and_left_out(scripted: ScriptedCamera) -> None:
    scripted.picture = lambda number: jpeg_picture(number)[: None if number % 2 else -300]
    with connected(Camera(scripted)) as camera, camera.stream() as stream:
        for frame, _ in zip(stream, range(10), strict=False):
            assert np.array_equal(frame.image(), decode(frame.encoded(), SIZE))
        assert camera.state.lost >= 9


def test_a_camera_that_sends_damaged_pictures_only_is_opened_again(
    camera: Camera, scripted: ScriptedCamera
) -> None:
    camera.fresh_frame()
    scripted.picture = lambda number: jpeg_picture(number)[:-300]
    wait_until(lambda: camera.state.reopened >= 1)
    assert camera.state.last_error == "sends nothing but damaged pictures"


def test_a_camera_with_its_cap_on_is_not_frozen(scripted: ScriptedCamera) -> None:
    scripted.picture = lambda number: np.zeros((48, 64, 3), np.uint8)
    with connected(Camera(scripted)) as camera:
        first = camera.fresh_frame()
        assert camera.fresh_frame().index > first.index
        assert camera.state.repeated == 0


def test_a_picture_that_comes_twice_is_one_frame(scripted: ScriptedCamera) -> None:
    scripted.picture = lambda number: jpeg_picture(number // 2)
    with connected(Camera(scripted)) as camera, camera.stream() as stream:
        stored = [frame.encoded() for frame, _ in zip(stream, range(10), strict=False)]
        assert len(set(stored)) == 10
        assert camera.state.repeated >= 9


def test_a_picture_that_never_came_is_counted_by_the_times_of_the_others() -> None:
    scripted = ScriptedCamera(fps=100.0, is_timed=True)
    with connected(Camera(scripted)) as camera:
        wait_until(lambda: camera.state.frames >= 20)
        lost = camera.state.lost
        scripted.is_frozen = True
        frames = camera.state.frames
        wait_until(lambda: time.monotonic() - scripted.exposures[-1][0] > 0.2)
        scripted.is_frozen = False
        wait_until(lambda: camera.state.frames > frames + 2)
        assert camera.state.lost - lost >= 10


@pytest.mark.parametrize(
    ("rotation", "is_mirrored", "turn"),
    [
        (0, True, lambda image: image[:, ::-1]),
        (90, False, lambda image: np.rot90(image, -1)),
        (180, False, lambda image: image[::-1, ::-1]),
        (270, False, lambda image: np.rot90(image)),
        (90, True, lambda image: np.rot90(image, -1)[:, ::-1]),
    ],
)
def test_a_camera_that_hangs_askew_gives_upright_pictures(
    rotation: int, is_mirrored: bool, turn: Callable[[object], object]
) -> None:
    scripted = ScriptedCamera()
    camera = Camera(scripted, rotation=rotation, is_mirrored=is_mirrored)  # type: ignore[arg-type]
    with connected(camera):
        frame = camera.fresh_frame()
        image = np.asarray(turn(noise_picture(scripted.numbers[frame.index])))
        assert np.array_equal(frame.image(), image)
        assert frame.size == camera.facts.size == image.shape[1::-1]
        assert np.array_equal(decode(frame.encoded(), frame.size), image)


def test_the_camera_s_own_jpeg_is_stored_unless_it_must_be_turned(scripted: ScriptedCamera) -> None:
    scripted.picture = jpeg_picture
    with connected(Camera(scripted)) as camera:
        frame = camera.fresh_frame()
        assert frame.encoded() == jpeg_picture(scripted.numbers[frame.index])
    with connected(Camera(scripted, rotation=180)) as camera:
        frame = camera.fresh_frame()
        assert inspect(frame.encoded()).format == "png"
        assert inspect(frame.encoded("jpeg")).format == "jpeg"


def test_a_picture_that_must_be_made_is_made_once_and_only_if_somebody_looks() -> None:
    made = []

    class Painter(ScriptedCamera):
        def grab(self, timeout_s: float) -> RawFrame:
            super().grab(timeout_s)
            number = self.numbers[-1]

            def paint() -> bytes:
                made.append(number)
                return jpeg_picture(number)

            return RawFrame(paint)

    with connected(Camera(Painter())) as camera:
        frame = camera.fresh_frame()
        assert not made
        threads = [threading.Thread(target=lambda: frame.image(grey=True)) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert inspect(frame.encoded()).format == "jpeg"
        assert len(made) == 1
        assert frame.image() is frame.image()


def test_settings_of_a_use_are_written_where_they_differ_and_hold_for_later_fresh_frames() -> None:
    scripted = ScriptedCamera(is_timed=True, delay_s=0.05)
    settings = {
        Use.LASER: CameraSettings({_EXPOSURE: 200.0, _GAIN: 1.0, _FOCUS: 7.0}),
        Use.TEXTURE: CameraSettings({_EXPOSURE: 9000.0, _GAIN: 1.0}),
    }
    with connected(Camera(scripted, settings=settings)) as camera:
        for use, exposure_us in 3 * [(Use.LASER, 200.0), (Use.TEXTURE, 9000.0)]:
            camera.prepare(use)
            assert camera.fresh_frame().exposure_us == exposure_us
            camera.prepare(use)
        camera.prepare(Use.BOARD)
    assert scripted.written.count((_GAIN, 1.0)) == 1
    assert len(scripted.written) == 7


def test_a_control_that_works_one_picture_late_is_waited_for() -> None:
    scripted = ScriptedCamera(fps=50.0, is_timed=True)
    scripted.late_s = 0.9 / scripted.fps
    with connected(Camera(scripted)) as camera:
        for exposure_us in (100.0, 200.0, 300.0, 400.0):
            camera.set_control(_EXPOSURE, exposure_us)
            assert camera.fresh_frame().exposure_us == exposure_us


def test_exposure_can_be_left_to_the_camera(camera: Camera) -> None:
    assert camera.set_control(_EXPOSURE, None).is_automatic
    assert camera.controls()[_EXPOSURE].is_automatic


def test_a_camera_that_was_never_connected_says_so(scripted: ScriptedCamera) -> None:
    camera = Camera(scripted, name="cyclops")
    asks: list[Callable[[], object]] = [
        camera.fresh_frame, camera.controls, lambda: camera.facts, lambda: next(open_stream(camera)),
    ]  # fmt: skip
    for ask in asks:
        with pytest.raises(DeviceError, match="cyclops: is not connected"):
            ask()
    assert camera.latest() is None
    assert not camera.state.is_connected
    camera.disconnect()


def test_a_frozen_camera_can_be_let_go_at_once() -> None:
    scripted = ScriptedCamera()
    errors: list[DeviceError] = []
    before = set(threading.enumerate())

    def wait(camera: Camera) -> None:
        try:
            camera.fresh_frame(timeout_s=60.0)
        except DeviceError as error:
            errors.append(error)

    with connected(Camera(scripted)) as camera:
        scripted.is_frozen = True
        waiting = threading.Thread(target=wait, args=(camera,))
        waiting.start()
        camera.disconnect()
        waiting.join(_SOON_S)
        assert errors
        assert set(threading.enumerate()) <= before


@contextlib.contextmanager
def connected(camera: Camera) -> Iterator[Camera]:
    camera.connect()
    try:
        yield camera
    finally:
        camera.disconnect()


def open_stream(camera: Camera) -> Iterator[object]:
    with camera.stream() as stream:
        yield stream


def reopen(camera: Camera, scripted: ScriptedCamera) -> None:
    scripted.is_gone = True
    wait_until(lambda: not camera.state.is_connected)
    scripted.is_gone = False
    wait_until(lambda: camera.state.is_connected)


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + _SOON_S
    while not is_so():
        assert time.monotonic() < deadline_s
        time.sleep(0.002)
