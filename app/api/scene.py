"""The 3D view as the API steers it: what is shown, and how."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from app.geometry.cloud import PointCloud
from app.scanning.profile import Profile


class Drawer(Protocol):
    """What draws the scene; see `CloudView`."""

    def begin(self, laser_names: Sequence[str]) -> None: ...
    def add(self, profile: Profile) -> None: ...
    def finish(self) -> None: ...
    def clear(self) -> None: ...
    def show_cloud(self, cloud: PointCloud) -> None: ...
    def colour_by(self, mode: str) -> None: ...
    def set_point_size(self, size_mm: float) -> None: ...
    def set_dark(self, is_dark: bool) -> None: ...
    def look(self, preset: str, tab: str | None = None) -> None: ...

    @property
    def viewers(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Shown:
    """What the view shows.

    Attributes:
        is_live: the points of a scan that goes on, or has just ended.
        scan: the finished scan that is shown, by its name in the library; empty for none.
        cloud: the file of its cloud.
        points: as many as the scan or cloud has.
        colour: what the colour of a point says.
        point_size_mm: as drawn.
        is_dark: for a dark page.
    """

    is_live: bool = False
    scan: str = ""
    cloud: str = ""
    points: int = 0
    colour: str = "height"
    point_size_mm: float = 0.6
    is_dark: bool = True


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
            self._shown = replace(self._shown, is_live=True, scan="", cloud="", points=0)

    def add(self, profile: Profile) -> None:
        """Points of the scan that goes on; they do not disturb whoever looks at another."""
        with self._lock:
            if self._shown.is_live:
                self._drawer.add(profile)
                self._shown = replace(self._shown, points=self._shown.points + len(profile))

    def finish(self) -> None:
        """The scan has ended."""
        with self._lock:
            if self._shown.is_live:
                self._drawer.finish()

    def show_cloud(self, scan: str, name: str, cloud: PointCloud) -> None:
        """A cloud of a finished scan, instead of what is there."""
        with self._lock:
            self._drawer.show_cloud(cloud)
            self._shown = replace(self._shown, is_live=False, scan=scan, cloud=name, points=len(cloud))

    def clear(self) -> None:
        """An empty table."""
        with self._lock:
            self._drawer.clear()
            self._shown = replace(self._shown, is_live=False, scan="", cloud="", points=0)

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
