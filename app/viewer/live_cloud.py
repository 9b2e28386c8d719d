"""The cloud that is shown: what comes in, how it is coloured, how it ends."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from viser import SceneNodeHandle, ViserServer

from app.geometry.arrays import Points, Vector3
from app.geometry.cloud import PointCloud
from app.scanning.profile import Profile
from app.viewer.chunks import CloudChunks
from app.viewer.cloud_nodes import ViserCloud
from app.viewer.colouring import Colouring, ColourMode
from app.viewer.crop import CropBox, CropLines
from app.viewer.display import DisplayPoints
from app.viewer.marks import Marks
from app.viewer.measure import Measure
from app.viewer.picking import Ray, point_under
from app.viewer.stage import TABLE

_MESH = f"{TABLE}/mesh"
_MESH_COLOUR = (214, 205, 190)
# Stray points must not stretch the ramp of heights.
_TOP_PERCENTILE = 99.5
_HIGHEST_MM = 1e5


class LiveCloud:
    """One scan, one finished cloud or one mesh on the table; used by one thread.

    Args:
        server: draws it.
        budget: most points that are shown.

    Attributes:
        measure: the distance that is drawn into it.
        marks: places that were pointed at.
    """

    def __init__(self, server: ViserServer, budget: int) -> None:
        self._server = server
        self._nodes = ViserCloud(server)
        self._chunks = CloudChunks(self._nodes, budget)
        self._mesh: SceneNodeHandle | None = None
        self._laser_names: tuple[str, ...] = ()
        self._box = CropLines(server)
        self.measure = Measure(server)
        self.marks = Marks(server)

    def __len__(self) -> int:
        """Points that are shown."""
        return len(self._chunks)

    @property
    def has_leaving(self) -> bool:
        """Whether nodes wait to be swept."""
        return self._chunks.has_leaving

    def begin(self, laser_names: tuple[str, ...]) -> None:
        """Make room for a new scan."""
        self.clear()
        self._laser_names = laser_names
        self._nodes.colouring = Colouring(self._nodes.colouring.mode)

    def push(self, profiles: Sequence[Profile]) -> None:
        """Show the points of profiles, the newest of each laser marked."""
        parts = [(profile.laser, self._shown(profile.cloud)) for profile in profiles if len(profile)]
        shown = DisplayPoints.joined([part for _, part in parts])
        if not len(shown):
            return
        top_mm = _top_of(shown)
        if top_mm > self._nodes.colouring.top_mm:
            self._raise_top(top_mm)
        with self._server.atomic():
            self._chunks.grow(shown)
            self._nodes.highlight(DisplayPoints.joined(list(dict(parts).values())))

    def sweep(self) -> None:
        """Take away nodes whose points stand in others by now."""
        with self._server.atomic():
            self._chunks.sweep()

    def finish(self) -> None:
        """Take the mark away and show the points exactly."""
        shown = self._chunks.all_points()
        if len(shown):
            self._nodes.colouring = Colouring(self._nodes.colouring.mode, _top_of(shown))
        with self._server.atomic():
            self._nodes.unmark()
            self._chunks.settle()

    def show(self, cloud: PointCloud) -> None:
        """Show a whole cloud instead of what is there."""
        self.begin(cloud.laser_names)
        shown = DisplayPoints.of(cloud)
        if len(shown):
            self._nodes.colouring = Colouring(self._nodes.colouring.mode, _top_of(shown))
        with self._server.atomic():
            self._chunks.replace(shown)

    def show_mesh(
        self,
        vertices: Points | NDArray[np.float32],
        faces: NDArray[np.integer],
        colours: NDArray[np.uint8] | None = None,
    ) -> None:
        """Show a surface instead of what is there."""
        self.clear()
        if colours is not None:
            # Loaded here: it takes a while, and scanning does not need it.
            import trimesh

            coloured = trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)
            self._mesh = self._server.scene.add_mesh_trimesh(_MESH, coloured)
            return
        self._mesh = self._server.scene.add_mesh_simple(
            _MESH, np.asarray(vertices, np.float32), np.asarray(faces, np.uint32), color=_MESH_COLOUR,
            side="double",
        )  # fmt: skip

    def clear(self) -> None:
        with self._server.atomic():
            self._nodes.unmark()
            self._nodes.crop = None
            self._box.draw(None)
            self.measure.clear()
            self.marks.draw((), None)
            self._chunks.clear()
            if self._mesh is not None:
                self._mesh.remove()
                self._mesh = None

    def colour_by(self, mode: ColourMode) -> None:
        if mode != self._nodes.colouring.mode:
            self._repaint(Colouring(mode, self._nodes.colouring.top_mm))

    def crop(self, box: CropBox | None) -> None:
        """Show what lies within the box alone; everything where there is none."""
        self._nodes.crop = box
        with self._server.atomic():
            self._box.draw(box)
            self._chunks.repaint()

    def point_under(self, ray: Ray) -> Vector3 | None:
        """The point that is seen there; none where only the ground is."""
        shown = self._chunks.all_points()
        if self._nodes.crop is not None:
            shown = self._nodes.crop.of(shown)
        return point_under(ray, shown.points)

    def resize(self, size_mm: float) -> None:
        with self._server.atomic():
            self._nodes.resize(size_mm)

    def _shown(self, cloud: PointCloud) -> DisplayPoints:
        """The points with the numbers that this scan gives its lasers."""
        shown = DisplayPoints.of(cloud)
        if cloud.laser_names in ((), self._laser_names):
            return shown
        self._laser_names += tuple(name for name in cloud.laser_names if name not in self._laser_names)
        numbers = np.array([self._laser_names.index(name) for name in cloud.laser_names], np.uint8)
        return DisplayPoints(
            shown.points, shown.texture, shown.shade, numbers[shown.laser], shown.turn, shown.quality
        )

    def _raise_top(self, top_mm: float) -> None:
        """Let the ramp of heights reach further: doubled, so that few points are painted twice."""
        reach_mm = self._nodes.colouring.top_mm
        while reach_mm < min(top_mm, _HIGHEST_MM):
            reach_mm *= 2.0
        colouring = Colouring(self._nodes.colouring.mode, reach_mm)
        if colouring.mode == "height":
            self._repaint(colouring)
        else:
            self._nodes.colouring = colouring

    def _repaint(self, colouring: Colouring) -> None:
        self._nodes.colouring = colouring
        with self._server.atomic():
            self._chunks.repaint()


def _top_of(shown: DisplayPoints) -> float:
    return max(1.0, float(np.percentile(shown.points[:, 2], _TOP_PERCENTILE)))
