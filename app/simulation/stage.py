"""What can stand before the simulated camera, and the pictures of it."""

import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from app.geometry.transform import RigidTransform, rotation_about
from app.simulation.beam import Glow
from app.simulation.boards import board_body, board_plate, table_bodies
from app.simulation.exposure import SensorSettings
from app.simulation.objects import SimulatedObject, make_object
from app.simulation.poses import fitting_board, standing_pose, tipped_pose
from app.simulation.render import Renderer
from app.simulation.rig import Z_UP
from app.simulation.scene import Body, Scene
from app.simulation.view import View
from app.simulation.world_plan import WorldPlan
from app.vision.stripe import Image

Thing: TypeAlias = Literal["object", "object-lying", "nothing", "board-on-table", "board-in-hands"]
_KEPT_RENDERERS = 4
_LYING_DEG = 90.0
_KEPT_VIEWS = 2


@dataclass(frozen=True, eq=False, slots=True)
class Moment:
    """Everything that a picture shows.

    Attributes:
        thing: what is there.
        placement: number of the place where the board stands on the table.
        camera_from_board: where the hands hold it.
        table_rad: angle of the table, counter-clockwise seen from above.
        room: brightness of the room.
        lasers: for what share of the exposure each was lit.
        seed: of the noise.
    """

    thing: Thing
    placement: int
    camera_from_board: RigidTransform | None
    table_rad: float
    room: float
    lasers: Mapping[str, float]
    seed: int


class Stage:
    """Builds the scenes when they are first seen, and keeps what the next picture may need again.

    Safe to use from several threads at once.

    Attributes:
        scanner: the true rig.
        item: what is scanned.
        board: what the hands hold.
    """

    def __init__(self, plan: WorldPlan) -> None:
        self.scanner = plan.scanner
        self.item: SimulatedObject = make_object(plan.object, plan.object_size_mm)
        self.board = plan.board or fitting_board(self.scanner.rig)
        self.board.check()
        self._plan = plan
        self._is_rehearsed = False
        self._lock = threading.Lock()
        self._renderers: OrderedDict[Hashable, Renderer] = OrderedDict()
        self._views: OrderedDict[Hashable, _Seen] = OrderedDict()

    @property
    def table_from_item(self) -> RigidTransform:
        """Where the object stands, at table angle 0: a little off the axis."""
        radius = self.scanner.table_radius_mm
        return RigidTransform(rotation_about(Z_UP, 0.4), np.array([0.07 * radius, -0.04 * radius, 0.0]))

    @property
    def table_from_lying_item(self) -> RigidTransform:
        """Where it lies on its side, likewise."""
        standing = self.table_from_item
        return tipped_pose(self.item.mesh.vertices, standing.rotation, standing.translation, _LYING_DEG)

    def table_from_board(self, placement: int) -> RigidTransform:
        """Where the board stands at table angle 0; places lie before and behind the axis in turns."""
        radius, rng = self.scanner.table_radius_mm, np.random.default_rng([self._plan.seed, placement])
        towards = (0.40 if placement % 2 == 0 else -0.28) * radius * (1.0 - 0.1 * (placement // 2 % 4))
        return standing_pose(
            board_plate(self.board), towards, rng.uniform(-0.1, 0.1) * radius,
            np.radians(rng.uniform(-6.0, 6.0)), np.radians(rng.uniform(2.0, 12.0)),
        )  # fmt: skip

    def rehearse(self) -> None:
        """Compile and draw beforehand what the first picture would take long for; once."""
        if self._is_rehearsed:
            return
        lasers = dict.fromkeys(self.scanner.sources, 1.0)
        self.picture(Moment("object", 0, None, 0.0, 1.0, lasers, 0), SensorSettings())
        self._is_rehearsed = True

    def picture(self, moment: Moment, settings: SensorSettings) -> Image:
        """What the camera makes of a moment, (H, W, 3)."""
        renderer = self._renderer(moment, settings)
        seen = self._seen(renderer, moment)
        exposure = settings.exposure(moment.room, moment.lasers)
        lasers = {name: seen.laser(name, renderer) for name in moment.lasers}
        return renderer.sense(seen.view, lasers, moment.seed, exposure=exposure)

    def _renderer(self, moment: Moment, settings: SensorSettings) -> Renderer:
        placement = moment.placement if moment.thing == "board-on-table" else 0
        key = moment.thing, placement, round(settings.blur_px(1.0), 2)
        with self._lock:
            if key not in self._renderers:
                scene = self._scene(moment.thing, placement)
                blur_px = settings.blur_px(scene.lens_blur_px)
                self._renderers[key] = Renderer(replace(scene, lens_blur_px=blur_px))
            self._renderers.move_to_end(key)
            while len(self._renderers) > _KEPT_RENDERERS:
                self._renderers.popitem(last=False)
            return self._renderers[key]

    def _seen(self, renderer: Renderer, moment: Moment) -> "_Seen":
        """The view of a moment; that of a table which stands is computed once."""
        if moment.camera_from_board is not None:
            pose = self.scanner.table_from_camera @ moment.camera_from_board
            return _Seen(renderer.look(0.0, {0: pose}))
        key = renderer, moment.table_rad
        with self._lock:
            seen = self._views.get(key)
        if seen is None:
            seen = _Seen(renderer.look(moment.table_rad))
            with self._lock:
                self._views[key] = seen
                while len(self._views) > _KEPT_VIEWS:
                    self._views.popitem(last=False)
        return seen

    def _scene(self, thing: Thing, placement: int) -> Scene:
        table = table_bodies(self.scanner.table_radius_mm, self._plan.platter)
        bodies: tuple[Body, ...] = table
        if thing == "object":
            bodies = (*table, Body(self.item.mesh, self.table_from_item, True))
        elif thing == "object-lying":
            bodies = (*table, Body(self.item.mesh, self.table_from_lying_item, True))
        elif thing == "board-on-table":
            bodies = (*table, board_body(self.board, self.table_from_board(placement), turns=True))
        elif thing == "board-in-hands":
            # Hands move through the place where the table is; it is out of the way then.
            bodies = (board_body(self.board, RigidTransform.identity(), turns=True),)
        return Scene(self.scanner, bodies, noise=self._plan.noise)


class _Seen:
    """A view, and the lasers' light on it as far as somebody wanted it."""

    def __init__(self, view: View) -> None:
        self.view = view
        self._lasers: dict[str, Glow] = {}

    def laser(self, name: str, renderer: Renderer) -> Glow:
        light = self._lasers.get(name)
        if light is None:
            light = self._lasers[name] = renderer.glow(self.view, name)
        return light
