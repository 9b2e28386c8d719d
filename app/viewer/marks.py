"""Places of the cloud that somebody has pointed at, each with its number."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from viser import SceneNodeHandle, ViserServer

from app.geometry.arrays import Vector3
from app.viewer.digits import strokes
from app.viewer.picking import Ray
from app.viewer.stage import TABLE

_MARKS = f"{TABLE}/marks"
_COLOUR = (255, 196, 60)
_DOT_MM = 2.4
# Of a digit, in parts of the view's height.
_DIGIT = 0.024


class Marks:
    """Used by one thread."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._drawn: list[SceneNodeHandle] = []

    def draw(self, places: Sequence[Vector3], seen: Ray | None) -> None:
        """These instead of what is there; the numbers, from 1, face whoever has seen them."""
        scene = self._server.scene
        with self._server.atomic():
            while self._drawn:
                self._drawn.pop().remove()
            if not places or seen is None:
                return
            self._drawn.append(
                scene.add_point_cloud(
                    f"{_MARKS}/dots", np.array(places), _COLOUR, point_size=_DOT_MM, point_shape="circle",
                    point_shading="flat", precision="float32",
                )
            )  # fmt: skip
            lines = np.concatenate([_number(number, at, seen) for number, at in enumerate(places, start=1)])
            self._drawn.append(
                scene.add_line_segments(
                    f"{_MARKS}/numbers", lines, _COLOUR, thickness=3.0, thickness_units="screen"
                )
            )


def _number(number: int, at: Vector3, seen: Ray) -> NDArray[np.float64]:
    """(N, 2, 3) strokes of a number over a place."""
    half = 0.5 * _DIGIT * seen.spread * float(np.linalg.norm(at - seen.origin))
    flat = half * strokes(number)
    lines: NDArray[np.float64] = at + flat[..., :1] * seen.right + (flat[..., 1:] + 2.5 * half) * seen.up
    return lines
