"""The live 3D view: told what happens in any thread, drawn by one of its own."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from viser import ClientHandle

from app.errors import OptionError
from app.geometry.arrays import Points, Vector3
from app.geometry.cloud import PointCloud
from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform
from app.scanning.profile import Profile
from app.viewer.chunks import BUDGET_POINTS
from app.viewer.colouring import colour_mode
from app.viewer.crop import Corner, CropBox
from app.viewer.eyes import FAR_MM, FOV_RAD, NEAR_MM, place
from app.viewer.live_cloud import LiveCloud
from app.viewer.loopback import close_viser, open_viser, remote_port
from app.viewer.picking import Matrix4, Ray, view_matrix
from app.viewer.rotations import rotation_of
from app.viewer.stage import Stage
from app.vision.board import BoardSpec
from app.vision.stripe import Image

PictureSource = Callable[[], Image | None]
"""The newest camera picture, blue, green, red or grey; None where there is no newer one."""

_PULSE_S = 0.02
_TURN_PERIOD_S = 0.05
_CLOUD_PERIOD_S = 0.05
_PICTURE_PERIOD_S = 0.2
_CLOSING_S = 10.0
_PICKING_S = 20.0
_log = logging.getLogger(__name__)


class CloudView:
    """A scene that every viewer sees alike; each looks at it from where he likes.

    Every method returns at once and may be called from any thread; what was asked for is drawn in the order
    of the calls. Points are sent every 0.05 s, the table turns up to 20 times a second.

    Args:
        table_radius_mm: of the turntable.
        height_mm: of what may stand on it.
        budget: most points that are shown; the scan itself keeps all.

    Attributes:
        problem: what went wrong while drawing; empty while all is well.
    """

    def __init__(
        self, *, table_radius_mm: float = 100.0, height_mm: float = 150.0, budget: int = BUDGET_POINTS
    ) -> None:
        self.problem = ""
        self._server = open_viser()
        self._stage = Stage(self._server, table_radius_mm, height_mm)
        self._cloud = LiveCloud(self._server, budget)
        self._inbox: deque[Profile | Callable[[], None]] = deque()
        self._waiting: list[Profile] = []
        self._angles: deque[float] = deque(maxlen=1)
        self._source: PictureSource | None = None
        self._next_turn_s = self._next_cloud_s = self._next_picture_s = 0.0
        self._tabs: dict[int, str] = {}
        self._set_first_eye()
        self._wake, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="cloud view", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Where viser listens on the loopback interface."""
        return self._server.get_port()

    @property
    def viewers(self) -> int:
        """Pages that look at the scene."""
        return len(self._server.get_clients())

    def show_rig(
        self, rig: Rig, *, table_radius_mm: float | None = None, height_mm: float | None = None
    ) -> None:
        """Draw camera and laser sheets where a calibration says they are.

        Args:
            rig: the calibration.
            table_radius_mm, height_mm: of the table and what may stand on it; as before where not given.
        """

        def show() -> None:
            if table_radius_mm is not None or height_mm is not None:
                self._stage.set_table(
                    table_radius_mm or self._stage.table_radius_mm, height_mm or self._stage.height_mm
                )
            self._stage.show_rig(rig, ())
            self._set_first_eye()

        self._put(show)

    def show_boards(
        self, spec: BoardSpec, poses: Sequence[RigidTransform], *, on_table: bool = False
    ) -> None:
        """Draw the calibration board in the poses that were captured, until a scan is shown or none is given.

        Args:
            spec: the board.
            poses: camera_from_board of each view (a rig must be shown), or table_from_board.
            on_table: whether they are the latter.
        """
        self._put(lambda: self._stage.show_boards(spec, tuple(poses), on_table=on_table))

    def show_pictures(self, source: PictureSource | None) -> None:
        """Ask for the picture in the camera's frustum, five times a second while somebody watches."""
        self._source = source
        self._wake.set()

    def light(self, lasers: Collection[str]) -> None:
        """Tell which lasers are on."""
        lit = tuple(lasers)
        self._put(lambda: self._stage.light(lit))

    def turn_to(self, angle_rad: float) -> None:
        """Tell where the table stands, counter-clockwise seen from above."""
        self._angles.append(angle_rad)
        self._wake.set()

    def begin(self, laser_names: Sequence[str]) -> None:
        """Empty the table for a new scan."""
        names = tuple(laser_names)
        self._put(self._stage.take_boards_away)
        self._put(lambda: self._cloud.begin(names))

    def add(self, profile: Profile) -> None:
        """Show the points of a profile, and mark them as the newest of their laser."""
        self._put(profile)

    def finish(self) -> None:
        """The scan has ended: take the mark away and show the points exactly."""
        self._put(self._cloud.finish)

    def show_cloud(self, cloud: PointCloud) -> None:
        """Show a finished scan instead of what is there."""
        self._put(self._stage.take_boards_away)
        self._put(lambda: self._cloud.show(cloud))

    def show_mesh(
        self,
        vertices: Points | NDArray[np.float32],
        faces: NDArray[np.integer],
        colours: NDArray[np.uint8] | None = None,
    ) -> None:
        """Show a surface instead of what is there.

        Args:
            vertices: (N, 3) mm, table frame.
            faces: (M, 3) numbers of vertices, counter-clockwise from outside.
            colours: (N, 3) red, green, blue of the vertices; one for all where not given.
        """
        self._put(self._stage.take_boards_away)
        self._put(lambda: self._cloud.show_mesh(vertices, faces, colours))

    def clear(self) -> None:
        """Empty the table."""
        self._put(self._cloud.clear)

    def colour_by(self, mode: str) -> None:
        """Colour all points by what is known about each.

        Raises:
            OptionError: there is no such mode.
        """
        known = colour_mode(mode)
        self._put(lambda: self._cloud.colour_by(known))

    def set_point_size(self, size_mm: float) -> None:
        """Draw points so large; larger where some were left out.

        Raises:
            OptionError: that is no size.
        """
        if not 0.0 < size_mm <= 20.0:
            raise OptionError(f"Points cannot be {size_mm:g} mm large.", "Choose a size between 0 and 20 mm.")
        self._put(lambda: self._cloud.resize(size_mm))

    def set_dark(self, is_dark: bool) -> None:
        """Colours that suit a dark or a light page."""
        self._put(lambda: self._stage.set_dark(is_dark))

    def crop(self, low: Corner | None, high: Corner | None) -> None:
        """Show what lies in a box alone, until another cloud is shown.

        Args:
            low, high: its corners, mm in the table frame; none shows everything again.

        Raises:
            OptionError: the box has no inside.
        """
        box = None if low is None or high is None else CropBox(low, high)
        self._put(lambda: self._cloud.crop(box))

    def measure_at(self, tab: str, across: float, down: float) -> tuple[Corner, ...]:
        """Take the point that one page sees at a place as the next end of the measured distance.

        Waits until it is drawn; a third point begins anew.

        Args:
            tab: the name with which the page opened the view.
            across, down: 0..1 from the upper left corner of the view.

        Returns:
            The points there are now, mm in the table frame: one or two.

        Raises:
            OptionError: no such page looks, or there is no point.
        """
        found: list[Corner] = []

        def measure(sight: _Sight) -> None:
            ray = sight.ray(across, down)
            point = self._cloud.point_under(ray)
            if point is not None:
                self._cloud.measure.take(point, ray)
                found.extend(_corner(each) for each in self._cloud.measure.points)

        self._see(tab, measure)
        if not found:
            raise _no_point()
        return tuple(found)

    def pick_at(self, tab: str, across: float, down: float, before: Sequence[Corner] = ()) -> Corner:
        """The point that one page sees at a place; it is marked, and so are those that were picked before.

        Arguments and errors as of `measure_at`.
        """
        found: list[Corner] = []

        def pick(sight: _Sight) -> None:
            ray = sight.ray(across, down)
            point = self._cloud.point_under(ray)
            if point is not None:
                self._cloud.marks.draw([*(np.array(each) for each in before), point], ray)
                found.append(_corner(point))

        self._see(tab, pick)
        if not found:
            raise _no_point()
        return found[0]

    def forget_picks(self) -> None:
        """Take the marks of what was picked away."""
        self._put(lambda: self._cloud.marks.draw((), None))

    def view_matrix(self, tab: str) -> Matrix4:
        """How one page sees the table frame; see `picking.view_matrix`.

        Raises:
            OptionError: no such page looks.
        """
        found: list[Matrix4] = []
        self._see(tab, lambda sight: found.append(sight.matrix))
        if not found:
            raise OptionError("The 3D view is busy.", "Try again in a moment.")
        return found[0]

    def forget_measure(self) -> None:
        """Take the measured distance away."""
        self._put(self._cloud.measure.clear)

    def look(self, preset: str, tab: str | None = None) -> None:
        """Move viewers to a place from which the scene is good to see.

        Args:
            preset: one of `PRESETS`.
            tab: the name with which one page opened the view; all of them where not given.

        Raises:
            OptionError: there is no such preset, or no camera yet.
        """
        stage = self._stage
        eye, target = place(preset, stage.table_radius_mm, stage.height_mm, stage.world_from_camera)
        for client in self._clients_of(tab):
            with client.atomic():
                client.camera.position = eye
                client.camera.look_at = target

    def entered(self, port: int, tab: str) -> None:
        """A page that calls itself so talks to viser from that port."""
        self._tabs[port] = tab

    def left(self, port: int) -> None:
        self._tabs.pop(port, None)

    def settle(self, timeout_s: float = 30.0) -> bool:
        """Wait until all that was asked for has been drawn; False where that took too long."""
        done = threading.Event()
        self._put(done.set)
        return done.wait(timeout_s)

    def close(self) -> None:
        """End the server; viewers lose their connection."""
        self._closing.set()
        self._wake.set()
        self._thread.join(_CLOSING_S)
        close_viser(self._server)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _see(self, tab: str, act: Callable[["_Sight"], None]) -> None:
        """Act on what a page sees, once all that was asked for before is drawn. Raises as `measure_at`."""
        client = next(iter(self._clients_of(tab)), None)
        if client is None or client.camera.image_height == 0:
            raise OptionError("The 3D view of this page is not open.", "Wait until the cloud is seen.")
        camera = client.camera
        eye = RigidTransform(rotation_of(camera.wxyz), np.asarray(camera.position, np.float64))
        fov_rad, aspect = camera.fov, camera.aspect
        done = threading.Event()

        def see() -> None:
            try:
                act(_Sight(self._stage.table_from_world @ eye, fov_rad, aspect))
            finally:
                done.set()

        self._put(see)
        done.wait(_PICKING_S)

    def _clients_of(self, tab: str | None) -> Iterator[ClientHandle]:
        """The pages of that name; all where none is given."""
        for client_id, client in self._server.get_clients().items():
            port = remote_port(self._server, client_id)
            if tab is None or (port is not None and self._tabs.get(port) == tab):
                yield client

    def _put(self, item: Profile | Callable[[], None]) -> None:
        # Nobody takes anything out of it any more once the view is closed.
        if not self._closing.is_set():
            self._inbox.append(item)
            self._wake.set()

    def _work(self) -> None:
        while not self._closing.is_set():
            has_more = self._inbox or self._waiting or self._angles or self._cloud.has_leaving
            rest_s = None if self._source is None else _PICTURE_PERIOD_S
            self._wake.wait(_PULSE_S if has_more else rest_s)
            self._wake.clear()
            try:
                self._pulse()
            except Exception as error:  # noqa: BLE001 (edge of a thread: the next thing is drawn)
                self.problem = str(error) or type(error).__name__
                _log.exception("the 3D view could not draw something")
            self._closing.wait(_PULSE_S)

    def _pulse(self) -> None:
        while self._inbox:
            item = self._inbox.popleft()
            if isinstance(item, Profile):
                self._waiting.append(item)
            else:
                self._push()
                item()
        now = time.monotonic()
        if self._angles and now >= self._next_turn_s:
            self._next_turn_s = now + _TURN_PERIOD_S
            self._stage.turn(self._angles.pop())
        if now >= self._next_cloud_s:
            self._next_cloud_s = now + _CLOUD_PERIOD_S
            if self._waiting:
                self._push()
            elif self._cloud.has_leaving:
                self._cloud.sweep()
        if now >= self._next_picture_s and self._source is not None and self.viewers:
            self._next_picture_s = now + _PICTURE_PERIOD_S
            image = self._source()
            if image is not None:
                self._stage.show_picture(image)

    def _push(self) -> None:
        profiles, self._waiting = self._waiting, []
        if profiles:
            self._cloud.push(profiles)

    def _set_first_eye(self) -> None:
        """Where a new viewer finds himself."""
        eye, target = place("home", self._stage.table_radius_mm, self._stage.height_mm, None)
        camera = self._server.initial_camera
        camera.position, camera.look_at = eye, target
        camera.fov, camera.near, camera.far = FOV_RAD, NEAR_MM, FAR_MM


@dataclass(frozen=True, eq=False, slots=True)
class _Sight:
    """From where a page looks: table_from_eye, the height of its view in radians, width by height."""

    table_from_eye: RigidTransform
    fov_rad: float
    aspect: float

    def ray(self, across: float, down: float) -> Ray:
        return Ray.through(self.table_from_eye, self.fov_rad, self.aspect, across, down)

    @property
    def matrix(self) -> Matrix4:
        return view_matrix(self.table_from_eye.inverse(), self.fov_rad, self.aspect)


def _corner(point: Vector3) -> Corner:
    x, y, z = point.tolist()
    return x, y, z


def _no_point() -> OptionError:
    return OptionError("There is no point of the cloud.", "Press where the cloud is seen.")
