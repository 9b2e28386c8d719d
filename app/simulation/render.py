"""Seeded pictures of the true world.

Everything is triangles. A picture is drawn on the distorted rays of its pixels, so a pixel's depth is exact;
a laser lights what lies near its sheet and is not in its shadow; the sensor adds its noise. Only the part of
the picture that changes with the table is drawn anew.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from app.errors import OptionError
from app.geometry.transform import RigidTransform
from app.simulation import kernels
from app.simulation.beam import TINTS, Beam, Glow
from app.simulation.drawing import Drawing
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
    rims,
    within,
)
from app.simulation.noise import Noise, normal_numbers, speckle_levels
from app.simulation.scene import Scene
from app.simulation.view import View
from app.vision.stripe import Image

# What a camera without colours sees of each laser.
_GREY_TINT = 0.8
_LUMA = np.array([0.114, 0.587, 0.299], np.float32)


class Renderer:
    """A scene with everything computed that does not change from picture to picture.

    Safe to use from several threads at once.

    Attributes:
        scene: what it renders.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._drawing = drawing = Drawing(scene)
        rays = camera_rays(scene.scanner.rig.camera)
        height, width = rays.shape[:2]
        self._still = Layers.blank(rays, backdrop(width, height, scene.lighting))
        self._fixed = {n: drawing.placed(n, 0.0) for n in drawing.still}
        drawn = {n: drawing.draw(self._still, n, mesh) for n, mesh in self._fixed.items()}
        for n, box in drawn.items():
            drawing.print_on(self._still, n, box, 0.0)
        drawing.shade(self._still)
        self._still_ambient = self._blurred(self._still.seen)
        # Round bodies whose print turns.
        bodies = scene.bodies
        self._turning = {n: drawn[n] for n in drawn if bodies[n].turns and bodies[n].texture is not None}
        self._beams: dict[str, Beam] = {}
        self._last_rays: tuple[Box, F32] | None = None

    def look(self, angle_rad: float, moved: Mapping[int, RigidTransform] | None = None) -> View:
        """The scene at a table angle.

        Args:
            angle_rad: counter-clockwise seen from above.
            moved: table from body at angle 0, instead of the scene's, for bodies that turn.
        """
        drawing = self._drawing
        meshes = {n: drawing.placed(n, angle_rad, moved) for n in drawing.moving}
        pixels = {n: drawing.pixels(mesh) for n, mesh in meshes.items()}
        changes = [drawing.extent(n, meshes[n], pixels[n]) for n in meshes]
        reach, size = blur_reach(self.scene.lens_blur_px), self._still.depth.shape
        box = grown(around([*changes, *self._turning.values()]), reach, size)
        part = self._part(grown(box, reach, size))
        drawn = {n: drawing.draw(part, n, mesh, pixels[n]) for n, mesh in meshes.items()}
        for n in drawn:
            drawing.print_on(part, n, drawn[n], angle_rad, moved)
        for n in self._turning:
            drawing.print_on(part, n, self._turning[n], angle_rad)
        drawing.shade(part)
        ambient = self._blurred(part.seen)[area(within(box, part.box))]
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
        gathered = np.empty((box[1] - top, box[3] - left, channels), np.float32)
        for edge in rims(box, view.box):
            still = view.still_ambient[area(edge)]
            np.multiply(still, amounts[: edge[3] - edge[2]], out=gathered[area(within(edge, box))])
        inner = gathered[area(within(view.box, box))]
        np.multiply(view.part_ambient, amounts[: inner.shape[1]], out=inner)
        for number, (name, glow) in enumerate(lasers.items(), start=1):
            tint = TINTS[self.scene.scanner.sources[name].colour] if channels == 3 else (_GREY_TINT,)
            strength = colour * np.float32(exposure.lasers.get(name, 1.0))
            first = (number * height + glow.box[0]) * width + glow.box[2]
            kernels.speckle(
                glow.light, np.asarray(tint, np.float32) * strength, speckle_levels(noise.speckle),
                np.uint64(seed), first, width, gathered[area(within(glow.box, box))],
            )  # fmt: skip
        image = np.empty((height, width * channels), np.uint8)
        kernels.expose(
            view.still_ambient.reshape(height, -1), amounts.ravel(),
            gathered.reshape(gathered.shape[0], gathered.shape[1] * channels), top, left * channels,
            noise.electrons_per_grey, noise.read_grey**2, normal_numbers(), np.uint64(seed), image,
        )  # fmt: skip
        return image.reshape(height, width, channels) if channels == 3 else image

    def _part(self, box: Box) -> Layers:
        """A part of the still picture to draw on; that of a turning object hardly changes."""
        last = self._last_rays
        if last is None or last[0] != box:
            last = self._last_rays = box, self._still.rays[area(box)].copy()
        return self._still.part(box, last[1])

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
