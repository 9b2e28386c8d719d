"""Whether a mesh can be printed, and what to do where not."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from app.geometry.arrays import Floats
from app.geometry.mesh import TriangleMesh
from app.surface.meshing.topology import is_watertight, pieces_of, rim_edges

_PLA_G_PER_CM3 = 1.24
# What a nozzle of 0.4 mm puts down in two lines, and the beds that most people have.
_THIN_MM = 0.8
_THIN_SHARE = 0.01
_BED_MM = 220.0
_TINY_MM = 5.0
_RAYS = 2_000
_SKIN_MM = 1e-3


class State(StrEnum):
    """How a check ended."""

    GOOD = "good"
    DOUBT = "doubt"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check says.

    Attributes:
        check: `watertight`, `manifold`, `pieces`, `size` or `walls`.
        state: good, to be looked at, or not to be printed.
        sentence: what was found.
        advice: what to do; empty where all is well.
    """

    check: str
    state: State
    sentence: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class PrintReport:
    """A mesh as a printer sees it.

    Attributes:
        findings: one for each check.
        size_mm: along x, y and z.
        volume_cm3, area_cm2: of a closed mesh; the volume is 0 for an open one.
        pla_g: its weight in PLA, printed solid.
        wall_mm: thickness that all but a hundredth of the surface exceeds, roughly; None where unknown.
    """

    findings: tuple[Finding, ...]
    size_mm: tuple[float, float, float]
    volume_cm3: float
    area_cm2: float
    pla_g: float
    wall_mm: float | None

    @property
    def is_printable(self) -> bool:
        return all(finding.state is not State.BAD for finding in self.findings)


def check_print(mesh: TriangleMesh) -> PrintReport:
    """Look at a mesh as a printer would."""
    if not len(mesh):
        nothing = Finding("size", State.BAD, "The mesh has no triangles.", "Make it again from other points.")
        return PrintReport((nothing,), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, None)
    low, high = mesh.bounds()
    width, depth, height = (high - low).tolist()
    closed, solid = is_watertight(mesh), _solid(mesh)
    walls = None if solid is None or not closed else _walls(mesh, solid)
    wall_mm = None if walls is None else float(np.percentile(walls, 100.0 * _THIN_SHARE))
    volume = mesh.volume_mm3 / 1000.0 if closed else 0.0
    findings = [
        _watertight(mesh, closed), _manifold(solid is not None, closed), _pieces(mesh),
        _size((width, depth, height)),
    ]  # fmt: skip
    if wall_mm is not None:
        findings.append(_thickness(wall_mm))
    return PrintReport(
        tuple(findings),
        (width, depth, height),
        volume,
        mesh.area_mm2 / 100.0,
        volume * _PLA_G_PER_CM3,
        wall_mm,
    )


def _watertight(mesh: TriangleMesh, closed: bool) -> Finding:
    if closed:
        return Finding("watertight", State.GOOD, "The surface is closed.")
    edges = len(rim_edges(mesh))
    return Finding(
        "watertight", State.BAD, f"The surface is open along {edges:,} edges.", "Make a closed mesh of it."
    )


def _manifold(is_manifold: bool, closed: bool) -> Finding:
    if is_manifold:
        return Finding("manifold", State.GOOD, "Inside and outside are clear everywhere.")
    advice = "Make the mesh again with a finer or coarser detail." if closed else "Close the surface first."
    return Finding("manifold", State.BAD, "Inside and outside are not clear everywhere.", advice)


def _pieces(mesh: TriangleMesh) -> Finding:
    count = int(pieces_of(mesh).max()) + 1
    if count == 1:
        return Finding("pieces", State.GOOD, "It is one piece.")
    return Finding(
        "pieces",
        State.DOUBT,
        f"There are {count} pieces.",
        "Leave out smaller pieces, unless they are wanted.",
    )


def _size(size_mm: tuple[float, float, float]) -> Finding:
    words = " x ".join(f"{length:.1f}" for length in size_mm)
    if max(size_mm) > _BED_MM:
        return Finding(
            "size", State.DOUBT, f"It is {words} mm, more than the {_BED_MM:g} mm of a usual printer.",
            "Scale or cut it in the slicer.",
        )  # fmt: skip
    if max(size_mm) < _TINY_MM:
        return Finding("size", State.DOUBT, f"It is only {words} mm.", "Check the scan's calibration.")
    return Finding("size", State.GOOD, f"It is {words} mm.")


def _thickness(wall_mm: float) -> Finding:
    if wall_mm < _THIN_MM:
        return Finding(
            "walls", State.DOUBT, f"Walls are as thin as {wall_mm:.2f} mm at some places.",
            f"Look at the slicer's preview: usual nozzles print walls from {_THIN_MM:g} mm.",
        )  # fmt: skip
    return Finding("walls", State.GOOD, f"Walls are at least about {wall_mm:.1f} mm thick.")


def _solid(mesh: TriangleMesh) -> Any:
    """The mesh as manifold3d takes it; None where it does not."""
    # Loaded here: few commands need it.
    from manifold3d import Error, Manifold, Mesh

    solid = Manifold(Mesh(np.ascontiguousarray(mesh.vertices, np.float32), mesh.faces.astype(np.uint32)))
    return solid if solid.status() == Error.NoError and not solid.is_empty() else None


def _walls(mesh: TriangleMesh, solid: Any) -> Floats | None:
    """mm of material behind a sample of the surface, straight inwards."""
    vectors = mesh.face_vectors()
    areas = np.linalg.norm(vectors, axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(areas), min(_RAYS, len(areas)), p=areas / areas.sum())
    inward = -vectors[chosen] / areas[chosen, None]
    starts = mesh.corners()[chosen].mean(axis=1) + _SKIN_MM * inward
    low, high = mesh.bounds()
    reach = 2.0 * float(np.linalg.norm(high - low))
    found = []
    for start, direction in zip(starts, inward, strict=True):
        hits = solid.ray_cast(tuple(start.tolist()), tuple((start + reach * direction).tolist()))
        if hits:
            found.append(_SKIN_MM + reach * hits[0].distance)
    return np.array(found) if found else None
