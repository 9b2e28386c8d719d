"""Things to scan: made by name, or loaded from a file. Each stands on z = 0 in its own frame."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.errors import OptionError
from app.geometry.transform import RigidTransform, rotation_about
from app.simulation.mesh import Albedo, Mesh, from_trimesh, load_mesh, plain_mesh, standing_for
from app.simulation.swept import lathe, tube

_PLASTER: Albedo = (0.70, 0.74, 0.78)
_CLAY: Albedo = (0.38, 0.52, 0.72)
# Where the paint of the mug's bands begins, is full, is full to the last, and ends.
_BAND_RIMS_MM = (9.0, 10.8, 16.2, 18.0, 50.4, 52.2, 55.8, 57.6)


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedObject:
    """Something to scan.

    Attributes:
        name: what it was asked for as.
        mesh: its surface, mm, standing on z = 0 about the z axis.
        facts: what is known of it beyond the mesh, for the truth file (a radius, a centre).
    """

    name: str
    mesh: Mesh
    facts: Mapping[str, object]


def make_object(name: str, size_mm: float | None = None) -> SimulatedObject:
    """An object by name, or from the file of that name.

    Args:
        name: one of `object_names()`, or a path ending in .stl, .obj or .ply.
        size_mm: largest extent; every object has its own usual one, a file is taken as it is.

    Raises:
        OptionError: no such object or file, or a size that is not positive.
    """
    if size_mm is not None and not (np.isfinite(size_mm) and size_mm > 0.0):
        raise OptionError(f"An object cannot be {size_mm:g} mm large.", "Give a size above zero.")
    if Path(name).suffix.lower() in {".stl", ".obj", ".ply"}:
        made = SimulatedObject(Path(name).stem, _standing(load_mesh(Path(name), _PLASTER)), {})
    elif name in _MAKERS:
        made = _MAKERS[name]()
    else:
        known = ", ".join(object_names())
        raise OptionError(
            f"There is no object called {name!r}.", f"Choose one of {known}, or name an STL, OBJ or PLY file."
        )
    if size_mm is None:
        return made
    return _scaled(made, size_mm / float(np.ptp(made.mesh.vertices, axis=0).max()))


def object_names() -> tuple[str, ...]:
    return tuple(sorted(_MAKERS))


def sphere(radius_mm: float = 30.0) -> SimulatedObject:
    """A ball that touches the table; exact, whatever the triangles."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=5, radius=radius_mm)
    mesh = plain_mesh(ball.vertices, ball.faces, _PLASTER)
    mesh = standing_for(mesh, np.diag([1.0, 1.0, 1.0, -(radius_mm**2)]), np.ones(len(mesh.faces), np.bool_))
    up = RigidTransform(np.eye(3), np.array([0.0, 0.0, radius_mm]))
    return SimulatedObject(
        "sphere", mesh.moved(up), {"radius_mm": radius_mm, "centre_mm": [0.0, 0.0, radius_mm]}
    )


def cylinder(radius_mm: float = 25.0, height_mm: float = 55.0) -> SimulatedObject:
    """An upright cylinder; exact, whatever the triangles."""
    side = lathe(np.array([[radius_mm, 0.0], [radius_mm, height_mm]]), _PLASTER)
    mesh = Mesh.joined(
        [
            standing_for(side, np.diag([1.0, 1.0, 0.0, -(radius_mm**2)]), np.ones(len(side.faces), np.bool_)),
            lathe(np.array([[radius_mm, height_mm], [0.0, height_mm]]), _PLASTER),
            lathe(np.array([[0.0, 0.0], [radius_mm, 0.0]]), _PLASTER),
        ]
    )
    return SimulatedObject("cylinder", mesh, {"radius_mm": radius_mm, "height_mm": height_mm})


def cone(radius_mm: float = 30.0, height_mm: float = 60.0) -> SimulatedObject:
    """An upright cone; exact, whatever the triangles."""
    side = lathe(np.array([[radius_mm, 0.0], [0.0, height_mm]]), _CLAY)
    slope = radius_mm / height_mm
    quadric = np.diag([1.0, 1.0, -(slope**2), -(radius_mm**2)])
    quadric[2, 3] = quadric[3, 2] = slope * radius_mm
    mesh = Mesh.joined(
        [
            standing_for(side, quadric, np.ones(len(side.faces), np.bool_)),
            lathe(np.array([[0.0, 0.0], [radius_mm, 0.0]]), _CLAY),
        ]
    )
    return SimulatedObject("cone", mesh, {"radius_mm": radius_mm, "height_mm": height_mm})


def cube(side_mm: float = 45.0) -> SimulatedObject:
    """A cube with sharp edges: depth steps and flat faces."""
    from trimesh import creation

    box = creation.box((side_mm, side_mm, side_mm))
    turned = RigidTransform(rotation_about(np.array([0.0, 0.0, 1.0]), 0.3), np.array([0, 0, side_mm / 2]))
    return SimulatedObject("cube", from_trimesh(box, _CLAY).moved(turned), {"side_mm": side_mm})


def mug() -> SimulatedObject:
    """A mug with a handle and painted bands: an inside, a hole, shadows and albedo edges."""
    outer, wall, height, floor = 33.0, 3.5, 72.0, 5.0
    rim = wall / 2.0
    turn = np.linspace(0.0, np.pi, 9)[1:-1]
    lip = np.column_stack([outer - rim + rim * np.cos(turn), height - rim + rim * np.sin(turn)])
    outside = np.array([[outer, z] for z in (0.0, *_BAND_RIMS_MM, height - rim)])
    inside = np.array([[outer - wall, height - rim], [outer - wall, floor]])
    body = _banded(lathe(np.concatenate([outside, lip, inside]), _PLASTER), outer)
    bottoms = [
        lathe(np.array([[outer - wall, floor], [0.0, floor]]), _PLASTER),
        lathe(np.array([[0.0, 0.0], [outer, 0.0]]), _PLASTER),
    ]
    along = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 33)
    start = outer - wall / 2.0
    arc = np.column_stack(
        [start + 24.0 * np.cos(along) ** 0.8, np.zeros(33), height / 2.0 + 21.0 * np.sin(along)]
    )
    handle = tube(arc, 4.5, _PLASTER)
    mesh = Mesh.joined([body, *bottoms, handle])
    return SimulatedObject("mug", mesh, {"outer_radius_mm": outer, "height_mm": height})


def rabbit() -> SimulatedObject:
    """A sitting rabbit of rounded parts: something organic, with deep folds and thin ears."""
    from trimesh.creation import icosphere

    parts = [
        ((0.0, 0.0, 23.2), (26.0, 20.0, 23.0), 0.0),
        ((20.0, 0.0, 48.0), (16.0, 13.0, 13.5), 0.2),
        ((12.0, 7.0, 69.0), (4.5, 3.5, 17.0), -0.25),
        ((12.0, -7.0, 69.0), (4.5, 3.5, 17.0), -0.25),
        ((-25.0, 0.0, 16.0), (7.5, 7.5, 7.5), 0.0),
        ((20.0, 9.0, 7.0), (12.0, 6.0, 7.0), 0.0),
        ((20.0, -9.0, 7.0), (12.0, 6.0, 7.0), 0.0),
        ((-4.0, 15.0, 15.0), (15.0, 8.0, 14.5), 0.0),
        ((-4.0, -15.0, 15.0), (15.0, 8.0, 14.5), 0.0),
    ]
    pieces = []
    for centre, half, pitch in parts:
        ball = icosphere(subdivisions=4)
        fur = 1.0 + 0.012 * np.sin(9.0 * ball.vertices[:, 0] + centre[0]) * np.sin(
            8.0 * ball.vertices[:, 1]
        ) * np.cos(7.0 * ball.vertices[:, 2])
        shaped = plain_mesh(ball.vertices * fur[:, None] * np.array(half), ball.faces, _CLAY)
        lean = rotation_about(np.array([0.0, 1.0, 0.0]), pitch)
        pieces.append(shaped.moved(RigidTransform(lean, np.array(centre))))
    return SimulatedObject("rabbit", Mesh.joined(pieces), {})


def _banded(mesh: Mesh, outer_mm: float) -> Mesh:
    """Two painted bands on the outside."""
    albedo = mesh.albedo.copy()
    x, y, z = mesh.vertices.T
    is_outside = np.hypot(x, y) > outer_mm - 0.5
    albedo[is_outside & (z > 10.0) & (z < 17.0)] = (0.55, 0.33, 0.22)
    albedo[is_outside & (z > 52.0) & (z < 57.0)] = (0.20, 0.25, 0.62)
    return Mesh(
        mesh.vertices, mesh.normals, mesh.faces, albedo, mesh.quadrics, mesh.face_quadric, mesh.is_closed
    )


def _standing(mesh: Mesh) -> Mesh:
    """Moved so that it stands on z = 0 with its middle over the origin."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = (low + high) / 2.0
    return mesh.moved(RigidTransform(np.eye(3), np.array([-middle[0], -middle[1], -low[2]])))


def _scaled(made: SimulatedObject, scale: float) -> SimulatedObject:
    mesh = made.mesh
    shrink = np.diag([1.0 / scale, 1.0 / scale, 1.0 / scale, 1.0])
    facts = {key: (np.asarray(value) * scale).tolist() for key, value in made.facts.items()}
    scaled = Mesh(
        mesh.vertices * scale, mesh.normals, mesh.faces, mesh.albedo,
        shrink @ mesh.quadrics @ shrink, mesh.face_quadric, mesh.is_closed,
    )  # fmt: skip
    return SimulatedObject(made.name, scaled, facts)


_MAKERS: dict[str, Callable[[], SimulatedObject]] = {
    "sphere": sphere,
    "cylinder": cylinder,
    "cone": cone,
    "cube": cube,
    "mug": mug,
    "rabbit": rabbit,
}
