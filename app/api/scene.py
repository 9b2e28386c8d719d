"""The 3D view as the API steers it: what is shown, and how."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.scanning.profile import Profile

Corner = tuple[float, float, float]
"""x, y, z in mm, table frame."""
Box = tuple[Corner, Corner]
"""Its lowest and its highest corner."""


class Drawer(Protocol):
    """What draws the scene; see `CloudView`."""

    def begin(self, laser_names: Sequence[str]) -> None: ...
    def add(self, profile: Profile) -> None: ...
    def finish(self) -> None: ...
    def clear(self) -> None: ...
    def show_cloud(self, cloud: PointCloud) -> None: ...
    def show_mesh(
        self,
        vertices: NDArray[np.float32],
        faces: NDArray[np.int32],
        colours: NDArray[np.uint8] | None = None,
    ) -> None: ...
    def colour_by(self, mode: str) -> None: ...
    def set_point_size(self, size_mm: float) -> None: ...
    def set_dark(self, is_dark: bool) -> None: ...
    def look(self, preset: str, tab: str | None = None) -> None: ...
    def crop(self, low: Corner | None, high: Corner | None) -> None: ...
    def measure_at(self, tab: str, across: float, down: float) -> tuple[Corner, ...]: ...
    def forget_measure(self) -> None: ...
    def pick_at(self, tab: str, across: float, down: float, before: Sequence[Corner] = ()) -> Corner: ...
    def forget_picks(self) -> None: ...
    def view_matrix(self, tab: str) -> NDArray[np.float64]: ...

    @property
    def viewers(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Shown:
    """What the view shows.

    Attributes:
        is_live: the points of a scan that goes on, or has just ended.
        scan: the finished scan that is shown, by its name in the library; empty for none.
        cloud: the file of its cloud, or of its mesh where that is shown.
        points: as many as the scan or cloud has, or vertices.
        nowhere: more of the cloud that cannot be shown, because their positions are not finite.
        colour: what the colour of a point says.
        point_size_mm: as drawn.
        is_dark: for a dark page.
        extent: the box around all finite points of the scan or cloud; none while there are none.
        crop: the part that alone is shown; none where it is all.
        measured: the ends of the distance that is drawn: none, one or two.
    """

    is_live: bool = False
    scan: str = ""
    cloud: str = ""
    points: int = 0
    nowhere: int = 0
    colour: str = "height"
    point_size_mm: float = 0.6
    is_dark: bool = True
    extent: Box | None = None
    crop: Box | None = None
    measured: tuple[Corner, ...] = ()


class Scene:
    """Passes wishes on and remembers them, so that every page sees the same; from any thread."""

    def __init__(self, drawer: Drawer) -> None:
        self._drawer = drawer
        self._lock = threading.Lock()
        self._shown = Shown()

    @property
    def shown(self) -> Shown:
        return self._shown

    @property
    def viewers(self) -> int:
        return self._drawer.viewers

    def begin(self, laser_names: Sequence[str]) -> None:
        """Make room for a scan."""
        with self._lock:
            self._drawer.begin(laser_names)
            self._shown = replace(self._emptied(), is_live=True)

    def add(self, profile: Profile) -> None:
        """Points of the scan that goes on; they do not disturb whoever looks at another."""
        with self._lock:
            if self._shown.is_live:
                self._drawer.add(profile)
                self._shown = replace(
                    self._shown,
                    points=self._shown.points + len(profile),
                    extent=_around(self._shown.extent, profile.cloud),
                )

    def finish(self) -> None:
        """The scan has ended."""
        with self._lock:
            if self._shown.is_live:
                self._drawer.finish()

    def show_cloud(self, scan: str, name: str, cloud: PointCloud) -> None:
        """A cloud of a finished scan, instead of what is there; without the points that lie nowhere."""
        somewhere = cloud.select(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
        with self._lock:
            self._drawer.show_cloud(somewhere)
            self._shown = replace(
                self._emptied(), scan=scan, cloud=name, points=len(somewhere),
                nowhere=len(cloud) - len(somewhere), extent=_around(None, somewhere),
            )  # fmt: skip

    def show_mesh(self, scan: str, name: str, mesh: TriangleMesh) -> None:
        """A mesh of a finished scan, instead of what is there."""
        with self._lock:
            self._drawer.show_mesh(mesh.vertices, mesh.faces, mesh.colours)
            extent = _around_points(None, mesh.vertices)
            self._shown = replace(
                self._emptied(), scan=scan, cloud=f"meshes/{name}", points=len(mesh.vertices), extent=extent
            )

    def clear(self) -> None:
        """An empty table."""
        with self._lock:
            self._drawer.clear()
            self._shown = self._emptied()

    def crop(self, box: Box | None) -> None:
        """Show what lies in a box alone, or everything again.

        Raises:
            OptionError: the box has no inside.
        """
        with self._lock:
            self._drawer.crop(*(box or (None, None)))
            self._shown = replace(self._shown, crop=box)

    def measure_at(self, tab: str, across: float, down: float) -> None:
        """Take the point that a page sees at a place, 0..1 from its upper left corner.

        Raises:
            OptionError: there is no point.
        """
        # It waits for the drawing, and a scan must not wait with it.
        measured = self._drawer.measure_at(tab, across, down)
        with self._lock:
            self._shown = replace(self._shown, measured=measured)

    def forget_measure(self) -> None:
        """Take the measured distance away."""
        with self._lock:
            self._drawer.forget_measure()
            self._shown = replace(self._shown, measured=())

    def pick_at(self, tab: str, across: float, down: float, before: Sequence[Corner]) -> Corner:
        """The point that a page sees at a place, marked with those that were picked before.

        Raises:
            OptionError: there is no point.
        """
        return self._drawer.pick_at(tab, across, down, before)

    def forget_picks(self) -> None:
        """Take the marks away."""
        self._drawer.forget_picks()

    def view_matrix(self, tab: str) -> NDArray[np.float64]:
        """How a page sees the table frame, as `Lasso` takes it. Raises OptionError where it does not look."""
        return self._drawer.view_matrix(tab)

    def look(self, preset: str, tab: str | None) -> None:
        """Move one page, or all, to where the scene is good to see.

        Raises:
            OptionError: there is no such place, or no calibrated camera yet.
        """
        self._drawer.look(preset, tab)

    def colour_by(self, mode: str) -> None:
        """Raises OptionError where there is no such mode."""
        with self._lock:
            self._drawer.colour_by(mode)
            self._shown = replace(self._shown, colour=mode)

    def set_point_size(self, size_mm: float) -> None:
        """Raises OptionError where that is no size."""
        with self._lock:
            self._drawer.set_point_size(size_mm)
            self._shown = replace(self._shown, point_size_mm=size_mm)

    def set_dark(self, is_dark: bool) -> None:
        with self._lock:
            self._drawer.set_dark(is_dark)
            self._shown = replace(self._shown, is_dark=is_dark)

    def _emptied(self) -> Shown:
        """With nothing on the table, drawn as before."""
        return replace(
            self._shown,
            is_live=False,
            scan="",
            cloud="",
            points=0,
            nowhere=0,
            extent=None,
            crop=None,
            measured=(),
        )


def _around(extent: Box | None, cloud: PointCloud) -> Box | None:
    return _around_points(extent, cloud.points)


def _around_points(extent: Box | None, places: NDArray[np.float32]) -> Box | None:
    points = places[np.isfinite(places).all(axis=1)]
    if not len(points):
        return extent
    if extent is not None:
        points = np.vstack([points, np.asarray(extent, np.float32)])
    (x, y, z), (right, back, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return (x, y, z), (right, back, top)
