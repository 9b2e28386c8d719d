"""Bodies into layers: triangles, curved surfaces, prints and the room's light."""

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from app.geometry.arrays import Floats, unit
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform, rotation_about
from app.simulation import kernels
from app.simulation.layers import Box, Layers, camera_rays, within
from app.simulation.mesh import Mesh
from app.simulation.rig import Z_UP
from app.simulation.scene import COARSE_BLOCK, FINE_BLOCK, Scene

_TEXTURE_SAMPLES = 5
_BULGE_EVERY_PX = 16
_BULGE_SAFETY = 2.0


class Drawing:
    """How the bodies of a scene are drawn. Bodies go by their number in the scene.

    Attributes:
        scene: whose bodies.
        moving: numbers of those whose place in the picture changes.
        still: of the others; the print on a round one may turn nevertheless.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        bodies = list(enumerate(scene.bodies))
        self.moving = [n for n, body in bodies if body.turns and not body.is_round]
        self.still = [n for n, _ in bodies if n not in self.moving]
        width, height = scene.scanner.rig.camera.size
        self._size = height, width
        self._first = np.cumsum([0, *(len(body.mesh.faces) for _, body in bodies)])
        self._printed = {n: _printed_faces(body.mesh) for n, body in bodies if body.texture}
        self._bulge_per_px = bulge_per_px(scene.scanner.rig.camera)
        self._longest_mm = {n: _longest_edge_mm(scene.bodies[n].mesh) for n in self.moving}

    def placed(
        self, number: int, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None
    ) -> Mesh:
        """A body in the camera frame."""
        return self.scene.bodies[number].mesh.moved(self._place(number, angle_rad, moved))

    def _place(
        self, number: int, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None
    ) -> RigidTransform:
        """Camera from body."""
        body = self.scene.bodies[number]
        pose = body.pose if moved is None else moved.get(number, body.pose)
        turned = RigidTransform(rotation_about(Z_UP, angle_rad if body.turns else 0.0), np.zeros(3))
        return self.scene.scanner.rig.axis.camera_from_table @ turned @ pose

    def pixels(self, mesh: Mesh) -> Floats:
        """Where a mesh's vertices are seen."""
        camera = self.scene.scanner.rig.camera
        pixels: Floats = kernels.project(mesh.vertices, camera.matrix, camera.distortion, *camera.size)
        return pixels

    def extent(self, number: int, mesh: Mesh, pixels: Floats) -> Box:
        """Where a body can be seen at most."""
        height, width = self._size
        top, bottom, left, right, nearest_mm = kernels.bounds(mesh.vertices, pixels)
        if nearest_mm < 1.0:
            return 0, height, 0, width
        # Distortion bends the edges of a large triangle out of the box about its corners.
        longest_px = self._longest_mm[number] * float(self.scene.scanner.rig.camera.matrix.max()) / nearest_mm
        margin = 2.0 + 0.06 * longest_px
        return (
            *_clipped(top - margin, bottom + margin, height),
            *_clipped(left - margin, right + margin, width),
        )  # fmt: skip

    def draw(self, layers: Layers, number: int, mesh: Mesh, pixels: Floats | None = None) -> Box:
        """One body into the layers; the part of the picture in which it is seen."""
        if pixels is None:
            pixels = self.pixels(mesh)
        first, (top, _, left, _) = int(self._first[number]), layers.box
        here = pixels - np.array([left, top], np.float64)
        box = kernels.rasterise(
            mesh.vertices, here, mesh.normals, mesh.albedo, mesh.faces,
            layers.rays, layers.depth, layers.owner, layers.normal, layers.albedo,
            first, mesh.is_closed, self._bulge_per_px,
        )  # fmt: skip
        if box[0] >= box[1]:
            return 0, 0, 0, 0
        if len(mesh.quadrics):
            kernels.curve(
                layers.owner, first, mesh.quadrics, mesh.face_quadric,
                layers.rays, layers.depth, layers.normal,
            )  # fmt: skip
        return box[0] + top, box[1] + top, box[2] + left, box[3] + left

    def print_on(
        self, layers: Layers, number: int, box: Box, angle_rad: float,
        moved: Mapping[int, RigidTransform] | None = None,
    ) -> None:  # fmt: skip
        """What is printed on a body, on the pixels of a box that see it."""
        body = self.scene.bodies[number]
        texture = body.texture
        if texture is None or box[0] >= box[1]:
            return
        count, back = self._printed[number], self._place(number, angle_rad, moved).inverse()
        kernels.paint(
            within(box, layers.box), layers.owner, int(self._first[number]), count,
            back.rotation, back.translation, texture.albedo, texture.coarse, COARSE_BLOCK,
            texture.fine, FINE_BLOCK, texture.origin_mm, texture.texel_mm, _TEXTURE_SAMPLES,
            layers.rays, layers.albedo,
        )  # fmt: skip

    def shade(self, layers: Layers) -> None:
        """The room's light on everything that is seen."""
        lighting = self.scene.lighting
        kernels.shade(
            layers.owner, layers.normal, layers.albedo, _lamp(self.scene),
            lighting.lamp_grey, lighting.ambient_grey, layers.seen,
        )  # fmt: skip


def _clipped(first: float, last: float, size: int) -> tuple[int, int]:
    """The whole pixels from first to last that a picture has, the second not among them."""
    return min(max(math.floor(first), 0), size), min(max(math.ceil(last) + 1, 0), size)


@lru_cache(maxsize=4)
def bulge_per_px(camera: CameraIntrinsics) -> float:
    """How far the lens bends an edge out of the straight line, at most: px per squared length in px."""
    rays = camera_rays(camera)[::_BULGE_EVERY_PX, ::_BULGE_EVERY_PX].reshape(-1, 2).astype(np.float64)
    half = _BULGE_EVERY_PX / float(camera.matrix[0, 0])
    worst_px = 0.0
    for way in ((half, 0.0), (0.0, half), (half, half), (half, -half)):
        seen = [_seen_at(camera, rays + side * np.array(way)) for side in (-1.0, 0.0, 1.0)]
        sagitta_px = np.linalg.norm(0.5 * (seen[0] + seen[2]) - seen[1], axis=1)
        worst_px = max(worst_px, float(np.nanmax(sagitta_px / (np.hypot(*way) / half) ** 2)))
    return _BULGE_SAFETY * worst_px / (2.0 * _BULGE_EVERY_PX) ** 2


def _seen_at(camera: CameraIntrinsics, rays: Floats) -> Floats:
    ahead = np.column_stack([rays, np.ones(len(rays))])
    pixels: Floats = kernels.project(ahead, camera.matrix, camera.distortion, *camera.size)
    return pixels


def _printed_faces(mesh: Mesh) -> int:
    """How many triangles lie in the plane of the print; they come first in every printed body."""
    return int(np.count_nonzero(np.abs(mesh.vertices[mesh.faces][:, :, 2]).max(axis=1) < 1e-9))


def _longest_edge_mm(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


def _lamp(scene: Scene) -> Floats:
    """Direction of the lamp, camera frame: above, in front, to the left."""
    in_table = unit(np.array([0.45, -0.5, 0.75]))
    return scene.scanner.rig.axis.camera_from_table.rotation @ in_table
