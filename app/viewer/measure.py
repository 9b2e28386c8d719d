"""The distance between two points, drawn into the cloud."""

from collections.abc import Sequence

import numpy as np
from viser import SceneNodeHandle, ViserServer

from app.geometry.arrays import Vector3
from app.viewer.stage import TABLE

_MARK = f"{TABLE}/measure"
_COLOUR = (255, 196, 60)
_DOT_MM = 2.4


class Measure:
    """None, one or two points; a third begins anew. Used by one thread."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._drawn: list[SceneNodeHandle] = []
        self.points: tuple[Vector3, ...] = ()

    def take(self, point: Vector3) -> None:
        """Measure to this point, or from it."""
        self.points = (point,) if len(self.points) == 2 else (*self.points, point)
        self._draw()

    def clear(self) -> None:
        """Forget the points."""
        self.points = ()
        self._draw()

    def _draw(self) -> None:
        scene = self._server.scene
        with self._server.atomic():
            while self._drawn:
                self._drawn.pop().remove()
            if not self.points:
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
                    scene.add_label(
                        f"{_MARK}/label", f"{distance_mm(self.points):.2f} mm",
                        position=(first + second) / 2.0, anchor="bottom-center", font_screen_scale=1.3,
                    )
                )  # fmt: skip


def distance_mm(points: Sequence[Vector3]) -> float:
    """Between two points, straight."""
    first, second = points
    return float(np.linalg.norm(second - first))
