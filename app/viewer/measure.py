"""The distance between two points, drawn into the cloud."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from viser import SceneNodeHandle, ViserServer

from app.geometry.arrays import Vector3
from app.viewer.digits import strokes
from app.viewer.picking import Ray
from app.viewer.stage import TABLE

_MARK = f"{TABLE}/measure"
_COLOUR = (255, 196, 60)
_DOT_MM = 2.4
# Of a digit, in parts of the view's height.
_DIGIT = 0.02


class Measure:
    """None, one or two points; a third begins anew. Used by one thread."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._drawn: list[SceneNodeHandle] = []
        self.points: tuple[Vector3, ...] = ()

    def take(self, point: Vector3, seen: Ray) -> None:
        """Measure to this point, or from it; the number faces whoever has seen it."""
        self.points = (point,) if len(self.points) == 2 else (*self.points, point)
        self._draw(seen)

    def clear(self) -> None:
        """Forget the points."""
        self.points = ()
        self._draw(None)

    def _draw(self, seen: Ray | None) -> None:
        scene = self._server.scene
        with self._server.atomic():
            while self._drawn:
                self._drawn.pop().remove()
            if seen is None:
                return
            self._drawn.append(
                scene.add_point_cloud(
                    f"{_MARK}/ends", np.array(self.points), _COLOUR, point_size=_DOT_MM,
                    point_shape="circle", point_shading="flat", precision="float32",
                )
            )  # fmt: skip
            if len(self.points) == 2:
                first, second = self.points
                self._drawn.append(
                    scene.add_line_segments(
                        f"{_MARK}/line", np.array([[first, second]]), _COLOUR, thickness=3.0,
                        thickness_units="screen",
                    )
                )  # fmt: skip
                self._drawn.append(
                    scene.add_line_segments(
                        f"{_MARK}/number", _number(first, second, seen), _COLOUR, thickness=2.0,
                        thickness_units="screen",
                    )
                )  # fmt: skip


def distance_mm(points: Sequence[Vector3]) -> float:
    """Between two points, straight."""
    first, second = points
    return float(np.linalg.norm(second - first))


def _number(first: Vector3, second: Vector3, seen: Ray) -> NDArray[np.float64]:
    """(N, 2, 3) strokes of the distance in mm, over the middle of the line."""
    middle = (first + second) / 2.0
    half = 0.5 * _DIGIT * seen.spread * float(np.linalg.norm(middle - seen.origin))
    flat = half * strokes(f"{distance_mm((first, second)):.2f}")
    placed: NDArray[np.float64] = middle + flat[..., :1] * seen.right + (flat[..., 1:] + 3.0 * half) * seen.up
    return placed
