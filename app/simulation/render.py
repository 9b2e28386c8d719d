"""Seeded pictures of the true world.

Everything is triangles. A picture is drawn on the distorted rays of its pixels, so a pixel's depth is exact;
a laser lights what lies near its sheet and is not in its shadow; the sensor adds its noise. Only the part of
the picture that changes with the table is drawn anew.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Floats, unit
from app.geometry.transform import RigidTransform, rotation_about
from app.simulation import kernels
from app.simulation.beam import TINTS, Beam, Glow
from app.simulation.exposure import Exposure
from app.simulation.layers import (
    F32,
    Box,
    Layers,
    area,
    around,
    backdrop,
    blur_reach,
    blurred,
    camera_rays,
    grown,
)
from app.simulation.mesh import Mesh
from app.simulation.noise import Noise, normal_numbers, speckle_levels
from app.simulation.rig import Z_UP
from app.simulation.scene import COARSE_BLOCK, FINE_BLOCK, Scene
from app.vision.stripe import Image

_TEXTURE_SAMPLES = 5
# What a camera without colours sees of each laser.
_GREY_TINT = 0.8
_LUMA = np.array([0.114, 0.587, 0.299], np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What the camera sees at one angle of the table, before lasers and noise.

    Attributes:
        still: what never changes, over the whole picture.
        still_ambient: (H, W, C) grey levels of it in the room's light.
        part: a part of the picture as it is now.
        box: a little less: where `part_ambient` is right.
        part_ambient: (h, w, C) grey levels in the box.
        meshes: every body that moves, camera frame.
    """

    still: Layers
    still_ambient: F32
    part: Layers
    box: Box
    part_ambient: F32
    meshes: tuple[Mesh, ...]

    @property
    def depth(self) -> F32:
        """(H, W) mm along z, infinite where nothing is."""
        return _pasted(self.still.depth, self.part.box, self.part.depth)

    @property
    def owner(self) -> NDArray[np.int32]:
        """(H, W) number of the triangle seen there, counted over all bodies; -1 for none."""
        return _pasted(self.still.owner, self.part.box, self.part.owner)

    @property
    def normal(self) -> F32:
        """(H, W, 3) unit vectors out of the surface, camera frame."""
        return _pasted(self.still.normal, self.part.box, self.part.normal)

    @property
    def albedo(self) -> F32:
        """(H, W, 3) blue, green, red, 0..1."""
        return _pasted(self.still.albedo, self.part.box, self.part.albedo)

    @property
    def ambient(self) -> F32:
        """(H, W, C) grey levels in the room's light."""
        return _pasted(self.still_ambient, self.box, self.part_ambient)


class Renderer:
    """A scene with everything computed that does not change from picture to picture.

    Safe to use from several threads at once.

    Attributes:
        scene: what it renders.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        rays = camera_rays(scene.scanner.rig.camera)
        height, width = rays.shape[:2]
        self._first = np.cumsum([0, *(len(body.mesh.faces) for body in scene.bodies)])
        self._still = Layers.blank(rays, backdrop(width, height, scene.lighting))
        numbers = range(len(scene.bodies))
        self._moving = [n for n in numbers if scene.bodies[n].turns and not scene.bodies[n].is_round]
        self._printed = {n: _printed_faces(scene.bodies[n].mesh) for n in numbers if scene.bodies[n].texture}
        self._longest_mm = {n: _longest_edge_mm(scene.bodies[n].mesh) for n in self._moving}
        still = [n for n in numbers if n not in self._moving]
        self._fixed = {n: self._placed(n, 0.0) for n in still}
        drawn = {n: self._draw(self._still, n, mesh) for n, mesh in self._fixed.items()}
        for n in still:
            self._print(self._still, n, drawn[n], 0.0)
        self._shade(self._still)
        self._still_ambient = self._blurred(self._still.seen)
        # Round bodies whose print turns.
        self._turning = {n: drawn[n] for n in still if scene.bodies[n].turns and scene.bodies[n].texture}
        self._beams: dict[str, Beam] = {}

    def look(self, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None) -> View:
        """The scene at a table angle.

        Args:
            angle_rad: counter-clockwise seen from above.
            moved: table from body at angle 0, instead of the scene's, for bodies that turn.
        """
        meshes = {n: self._placed(n, angle_rad, moved) for n in self._moving}
        pixels = {n: self._pixels(mesh) for n, mesh in meshes.items()}
        changes = [self._extent(n, meshes[n], pixels[n]) for n in meshes]
        reach, size = blur_reach(self.scene.lens_blur_px), self._still.depth.shape
        box = grown(around([*changes, *self._turning.values()]), reach, size)
        part = self._still.part(grown(box, reach, size))
        drawn = {n: self._draw(part, n, mesh, pixels[n]) for n, mesh in meshes.items()}
        for n in drawn:
            self._print(part, n, drawn[n], angle_rad, moved)
        for n in self._turning:
            self._print(part, n, self._turning[n], angle_rad)
        self._shade(part)
        top, left = part.box[0], part.box[2]
        inner = box[0] - top, box[1] - top, box[2] - left, box[3] - left
        ambient = np.ascontiguousarray(self._blurred(part.seen)[area(inner)])
        return View(self._still, self._still_ambient, part, box, ambient, tuple(meshes.values()))

    def glow(self, view: View, laser: str) -> Glow:
        """What a laser adds to a view."""
        beam = self._beams.get(laser)
        if beam is None:
            if laser not in self.scene.scanner.sources:
                known = ", ".join(self.scene.scanner.sources)
                raise OptionError(f"There is no laser called {laser!r}.", f"Choose one of: {known}.")
            beam = Beam(self.scene, laser, self._still, list(self._fixed.values()))
            self._beams[laser] = beam
        return beam.glow(view.part, view.meshes)

    def irradiance(self, view: View, laser: str) -> F32:
        """Grey levels (H, W) that a laser adds, without speckle and clipping."""
        height, width = self._still.depth.shape
        return self.glow(view, laser).whole((height, width))

    def expose(self, view: View, lasers_on: Sequence[str], seed: int, noise: Noise | None = None) -> Image:
        """The picture with these lasers on.

        Args:
            view: from `look`.
            lasers_on: their names.
            seed: same seed, same bytes.
            noise: instead of the scene's.
        """
        return self.sense(view, {name: self.glow(view, name) for name in lasers_on}, seed, noise)

    def sense(
        self,
        view: View,
        lasers: Mapping[str, Glow],
        seed: int,
        noise: Noise | None = None,
        exposure: Exposure | None = None,
    ) -> Image:
        """As `expose`, from what each lit laser adds; `exposure` is how much of all that the camera takes."""
        exposure = exposure or Exposure()
        noise = exposure.noisy(noise or self.scene.noise)
        height, width, channels = view.still_ambient.shape
        colour = np.asarray(exposure.colour if channels == 3 else (1.0,), np.float32)
        amount = np.float32(exposure.room) * colour
        box = around([view.box, *(glow.box for glow in lasers.values())])
        top, left = box[0], box[2]
        amounts = np.tile(amount, width).reshape(width, channels)
        gathered = view.still_ambient[area(box)] * amounts[: box[3] - left]
        gathered[area(_within(view.box, box))] = view.part_ambient * amounts[: view.box[3] - view.box[2]]
        for number, (name, glow) in enumerate(lasers.items(), start=1):
            tint = TINTS[self.scene.scanner.sources[name].colour] if channels == 3 else (_GREY_TINT,)
            strength = colour * np.float32(exposure.lasers.get(name, 1.0))
            first = (number * height + glow.box[0]) * width + glow.box[2]
            kernels.speckle(
                glow.light, np.asarray(tint, np.float32) * strength, speckle_levels(noise.speckle),
                np.uint64(seed), first, width, gathered[area(_within(glow.box, box))],
            )  # fmt: skip
        image = np.empty((height, width * channels), np.uint8)
        kernels.expose(
            view.still_ambient.reshape(height, -1), amounts.ravel(),
            gathered.reshape(gathered.shape[0], gathered.shape[1] * channels), top, left * channels,
            noise.electrons_per_grey, noise.read_grey**2, normal_numbers(), np.uint64(seed), image,
        )  # fmt: skip
        return image.reshape(height, width, channels) if channels == 3 else image

    def _placed(
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

    def _pixels(self, mesh: Mesh) -> Floats:
        """Where a mesh's vertices are seen."""
        camera = self.scene.scanner.rig.camera
        pixels: Floats = kernels.project(mesh.vertices, camera.matrix, camera.distortion, *camera.size)
        return pixels

    def _extent(self, number: int, mesh: Mesh, pixels: Floats) -> Box:
        """Where a body can be seen at most."""
        height, width = self._still.depth.shape
        low, high = cv2.reduce(pixels, 0, cv2.REDUCE_MIN)[0], cv2.reduce(pixels, 0, cv2.REDUCE_MAX)[0]
        nearest_mm = float(cv2.reduce(mesh.vertices, 0, cv2.REDUCE_MIN)[0, 2])
        if nearest_mm < 1.0:
            return 0, height, 0, width
        # Distortion bends the edges of a large triangle out of the box about its corners.
        longest_px = self._longest_mm[number] * float(self.scene.scanner.rig.camera.matrix.max()) / nearest_mm
        margin = 2.0 + 0.06 * longest_px
        u0, v0 = np.clip(np.floor(low - margin), 0, [width, height]).astype(int).tolist()
        u1, v1 = np.clip(np.ceil(high + margin) + 1.0, 0, [width, height]).astype(int).tolist()
        return v0, v1, u0, u1

    def _draw(self, layers: Layers, number: int, mesh: Mesh, pixels: Floats | None = None) -> Box:
        """One body into the layers; the part of the picture in which it is seen."""
        if pixels is None:
            pixels = self._pixels(mesh)
        first, (top, _, left, _) = int(self._first[number]), layers.box
        here = pixels - np.array([left, top], np.float64)
        box = kernels.rasterise(
            mesh.vertices, here, mesh.faces, layers.rays, layers.depth, layers.owner, first, mesh.is_closed
        )
        if box[0] >= box[1]:
            return 0, 0, 0, 0
        kernels.resolve(
            layers.owner, first, mesh.vertices, mesh.normals, mesh.faces, mesh.albedo,
            layers.rays, layers.normal, layers.albedo,
        )  # fmt: skip
        if len(mesh.quadrics):
            kernels.curve(
                layers.owner, first, mesh.quadrics, mesh.face_quadric,
                layers.rays, layers.depth, layers.normal,
            )  # fmt: skip
        return box[0] + top, box[1] + top, box[2] + left, box[3] + left

    def _print(
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
            _within(box, layers.box), layers.owner, int(self._first[number]), count,
            back.rotation, back.translation, texture.albedo, texture.coarse, COARSE_BLOCK,
            texture.fine, FINE_BLOCK, texture.origin_mm, texture.texel_mm, _TEXTURE_SAMPLES,
            layers.rays, layers.albedo,
        )  # fmt: skip

    def _shade(self, layers: Layers) -> None:
        """The room's light on everything that is seen."""
        lighting = self.scene.lighting
        kernels.shade(
            layers.owner, layers.normal, layers.albedo, _lamp(self.scene),
            lighting.lamp_grey, lighting.ambient_grey, layers.seen,
        )  # fmt: skip

    def _blurred(self, seen: F32) -> F32:
        """What the lens makes of it, and a camera without colours."""
        if self.scene.is_grey:
            seen = np.ascontiguousarray((seen @ _LUMA)[:, :, None])
        return blurred(seen, self.scene.lens_blur_px)


def render_shot(scene: Scene, lasers_on: Sequence[str], angle_rad: float, rng: np.random.Generator) -> Image:
    """One picture of a scene; what can be kept from the last pictures of the same scene is."""
    renderer = renderer_of(scene)
    return renderer.expose(renderer.look(angle_rad), lasers_on, int(rng.integers(2**63)))


@lru_cache(maxsize=4)
def renderer_of(scene: Scene) -> Renderer:
    """The renderer of a scene, kept for the next pictures of it."""
    return Renderer(scene)


def _pasted(picture: NDArray, box: Box, part: NDArray) -> NDArray:  # type: ignore[type-arg]
    whole = picture.copy()
    whole[area(box)] = part
    return whole


def _within(box: Box, outer: Box) -> Box:
    """A box counted from the upper left corner of one around it."""
    top, left = outer[0], outer[2]
    return box[0] - top, box[1] - top, box[2] - left, box[3] - left


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
