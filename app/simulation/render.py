"""Seeded pictures of the true world.

Everything is triangles. A picture is drawn on the distorted rays of its pixels, so a pixel's depth is exact;
a laser lights what lies near its sheet and is not in its shadow; the sensor adds its noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from app.errors import OptionError
from app.geometry.arrays import Floats, unit
from app.geometry.transform import RigidTransform, rotation_about
from app.simulation import kernels
from app.simulation.exposure import Exposure
from app.simulation.layers import F32, Box, Layers, backdrop, blurred, camera_rays, projected
from app.simulation.mesh import Mesh
from app.simulation.noise import Noise, normal_levels, speckle_levels
from app.simulation.rig import Z_UP
from app.simulation.scene import BUSY_BLOCK, Scene
from app.simulation.sheet import FAN_BINS, Sheet
from app.vision.stripe import Image

_TEXTURE_SAMPLES = 5
# How strongly blue, green and red pixels see each laser; the leak gives a bright stripe its white core.
_TINTS = {
    "red": (0.035, 0.075, 1.0),
    "green": (0.10, 1.0, 0.07),
    "blue": (1.0, 0.16, 0.03),
    "any": (1.0, 1.0, 1.0),
}
# What a camera without colours sees of each.
_GREY_TINT = 0.8
_LUMA = np.array([0.114, 0.587, 0.299], np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What the camera sees at one angle of the table, before light and noise.

    Attributes:
        depth: (H, W) mm along z, infinite where nothing is.
        owner: (H, W) number of the triangle seen there, counted over all bodies; -1 for none.
        normal: (H, W, 3) unit vectors out of the surface, camera frame.
        albedo: (H, W, 3) blue, green, red, 0..1.
        ambient: (H, W, C) grey levels in the room's light.
        meshes: every body in the camera frame.
    """

    depth: F32
    owner: NDArray[np.int32]
    normal: F32
    albedo: F32
    ambient: F32
    meshes: tuple[Mesh, ...]


class Renderer:
    """A scene with everything computed that does not change from picture to picture.

    Safe to use from several threads at once.

    Attributes:
        scene: what it renders.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._rays = camera_rays(scene.scanner.rig.camera)
        height, width = self._rays.shape[:2]
        faces = [len(body.mesh.faces) for body in scene.bodies]
        self._first = np.cumsum([0, *faces])
        self._static = Layers.blank(width, height, backdrop(width, height, scene.lighting))
        self._fixed = {
            n: self._draw(self._static, n, 0.0)
            for n, body in enumerate(scene.bodies)
            if body.is_round or not body.turns
        }

    def look(self, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None) -> View:
        """The scene at a table angle.

        Args:
            angle_rad: counter-clockwise seen from above.
            moved: table from body at angle 0, instead of the scene's, for bodies that turn.
        """
        layers = self._static.copy()
        for number, drawn in self._fixed.items():
            if self.scene.bodies[number].is_round:
                self._colour(layers, number, drawn.box, self._place(number, angle_rad))
        meshes = [
            self._fixed[n].mesh if n in self._fixed else self._draw(layers, n, angle_rad, moved).mesh
            for n in range(len(self.scene.bodies))
        ]
        ambient = layers.seen
        if self.scene.is_grey:
            ambient = np.ascontiguousarray((ambient @ _LUMA)[:, :, None])
        ambient = blurred(ambient, self.scene.lens_blur_px)
        return View(layers.depth, layers.owner, layers.normal, layers.albedo, ambient, tuple(meshes))

    def irradiance(self, view: View, laser: str) -> F32:
        """Grey levels (H, W) that a laser adds, without speckle and clipping."""
        try:
            source = self.scene.scanner.sources[laser]
        except KeyError:
            known = ", ".join(self.scene.scanner.sources)
            raise OptionError(f"There is no laser called {laser!r}.", f"Choose one of: {known}.") from None
        plane = self.scene.scanner.rig.lasers[laser]
        sheet = Sheet.of(self.scene, source, plane.normal)
        reach = np.full((len(sheet.offsets_mm), FAN_BINS), np.inf, np.float32)
        fan = (plane.normal, plane.distance_mm, source.position_mm, sheet.forward, sheet.sideways)
        for mesh in view.meshes:
            kernels.cut(
                mesh.vertices, mesh.faces, *fan, sheet.offsets_mm, source.half_fan_rad,
                sheet.cosine, sheet.sine, reach,
            )  # fmt: skip
        lit = np.zeros(view.depth.shape, np.float32)
        colour = np.asarray(_TINTS[source.colour], np.float32)
        kernels.light(
            self._rays, view.depth, view.normal, view.albedo, colour / colour.sum(), *fan, sheet.offsets_mm,
            source.half_fan_rad, reach, source.sigma_mm, source.focus_mm, source.focus_depth_mm,
            source.peak_grey, lit,
        )  # fmt: skip
        return blurred(lit, self.scene.lens_blur_px)

    def expose(self, view: View, lasers_on: Sequence[str], seed: int, noise: Noise | None = None) -> Image:
        """The picture with these lasers on.

        Args:
            view: from `look`.
            lasers_on: their names.
            seed: same seed, same bytes.
            noise: instead of the scene's.
        """
        lasers = [self.irradiance(view, name) for name in lasers_on]
        return self.sense(view, dict(zip(lasers_on, lasers, strict=True)), seed, noise)

    def sense(
        self,
        view: View,
        lasers: Mapping[str, F32],
        seed: int,
        noise: Noise | None = None,
        exposure: Exposure | None = None,
    ) -> Image:
        """As `expose`, from what each lit laser adds; `exposure` is how much of all that the camera takes."""
        exposure = exposure or Exposure()
        noise = exposure.noisy(noise or self.scene.noise)
        channels = view.ambient.shape[2]
        colour = np.asarray(exposure.colour if channels == 3 else (1.0,), np.float32)
        tints = np.zeros((len(lasers), channels), np.float32)
        for n, name in enumerate(lasers):
            seen = _TINTS[self.scene.scanner.sources[name].colour] if channels == 3 else (_GREY_TINT,)
            tints[n] = np.float32(exposure.lasers.get(name, 1.0)) * colour * np.asarray(seen, np.float32)
        stack = np.stack(list(lasers.values())) if lasers else np.zeros((0, 1, 1), np.float32)
        image = np.empty(view.ambient.shape, np.uint8)
        kernels.expose(
            view.ambient * (np.float32(exposure.room) * colour), stack, tints,
            noise.electrons_per_grey, noise.read_grey**2, normal_levels(),
            speckle_levels(noise.speckle), np.uint64(seed), image,
        )  # fmt: skip
        return image if channels == 3 else image[:, :, 0]

    def _place(
        self, number: int, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None
    ) -> RigidTransform:
        """Camera from body."""
        body = self.scene.bodies[number]
        pose = body.pose if moved is None else moved.get(number, body.pose)
        turned = RigidTransform(rotation_about(Z_UP, angle_rad if body.turns else 0.0), np.zeros(3))
        return self.scene.scanner.rig.axis.camera_from_table @ turned @ pose

    def _draw(
        self, layers: Layers, number: int, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None
    ) -> "_Drawn":
        """One body into the layers."""
        place = self._place(number, angle_rad, moved)
        mesh = self.scene.bodies[number].mesh.moved(place)
        first = int(self._first[number])
        pixels = projected(self.scene.scanner.rig.camera, mesh.vertices)
        box = kernels.rasterise(
            mesh.vertices, pixels, mesh.faces, self._rays, layers.depth, layers.owner, first, mesh.is_closed
        )
        if box[0] < box[1]:
            kernels.resolve(
                box, layers.owner, first, mesh.vertices, mesh.normals, mesh.faces, mesh.albedo,
                mesh.quadrics, mesh.face_quadric, self._rays, layers.depth, layers.normal, layers.albedo,
            )  # fmt: skip
            self._colour(layers, number, box, place)
        return _Drawn(mesh, box)

    def _colour(self, layers: Layers, number: int, box: Box, place: RigidTransform) -> None:
        """Print and room light on the pixels that see a body."""
        body, first, lighting = self.scene.bodies[number], int(self._first[number]), self.scene.lighting
        texture = body.texture
        if texture is not None:
            is_printed = np.abs(body.mesh.vertices[body.mesh.faces][:, :, 2]).max(axis=1) < 1e-9
            # Triangles in the plane of the print come first in every printed body.
            count, back = int(np.count_nonzero(is_printed)), place.inverse()
            kernels.paint(
                box, layers.owner, first, count, back.rotation, back.translation,
                texture.albedo, texture.is_busy, BUSY_BLOCK, texture.origin_mm, texture.texel_mm,
                _TEXTURE_SAMPLES, self._rays, layers.albedo,
            )  # fmt: skip
        kernels.shade(
            box, layers.owner, first, layers.normal, layers.albedo, _lamp(self.scene),
            lighting.lamp_grey, lighting.ambient_grey, layers.seen,
        )  # fmt: skip


def render_shot(scene: Scene, lasers_on: Sequence[str], angle_rad: float, rng: np.random.Generator) -> Image:
    """One picture of a scene; what can be kept from the last pictures of the same scene is."""
    renderer = renderer_of(scene)
    return renderer.expose(renderer.look(angle_rad), lasers_on, int(rng.integers(2**63)))


@lru_cache(maxsize=4)
def renderer_of(scene: Scene) -> Renderer:
    """The renderer of a scene, kept for the next pictures of it."""
    return Renderer(scene)


@dataclass(frozen=True, eq=False, slots=True)
class _Drawn:
    mesh: Mesh
    box: Box


def _lamp(scene: Scene) -> Floats:
    """Direction of the lamp, camera frame: above, in front, to the left."""
    in_table = unit(np.array([0.45, -0.5, 0.75]))
    return scene.scanner.rig.axis.camera_from_table.rotation @ in_table
