"""A mesh from a cloud."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from app.errors import SurfaceError
from app.geometry.arrays import Floats, Points
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.colours import colours_at
from app.surface.meshing.base import foot_height, footprint
from app.surface.meshing.contour import contour
from app.surface.meshing.grid import Grid
from app.surface.meshing.holes import fill_holes
from app.surface.meshing.indicator import areas_of, level_of, solve_indicator
from app.surface.meshing.layout import Layout
from app.surface.meshing.options import MeshOptions
from app.surface.meshing.simplify import to_count, to_tolerance
from app.surface.meshing.snap import snap
from app.surface.meshing.topology import welded, with_faces, without_islands

Progress = Callable[[str, float], None]
"""Told what is being done, and how much of all is done, 0..1."""

_FEWEST_POINTS = 50
_CELL_SPACINGS = 1.5
# Cells between points across which a surface is still followed, and where normals are at odds.
_MOST_SPACING_CELLS, _STREWN_CELLS = 6.0, 2.0
_SNAP_CELLS = 1.5
_TRIM_CELLS = 2.0
# Ten kilometres: beyond it lies what was read wrongly.
_LARGEST_MM = 1e7
# Lower things are not told from the noise of their base.
_LEAST_CELLS = 3.0


def make_mesh(
    cloud: PointCloud, options: MeshOptions | None = None, progress: Progress | None = None
) -> TriangleMesh:
    """The surface that the points of a cloud lie on.

    Args:
        cloud: with normals, in the table frame; points without one are left out.
        options: closed on a flat base where not given.
        progress: told how far it is.

    Raises:
        SurfaceError: there are too few points with normals, or for the detail; they span nothing, or close
            around nothing.
    """
    options = options or MeshOptions()
    tell = progress or (lambda words, share: None)
    usable = _usable(cloud)
    points, normals, weights = usable.points, usable.normals, usable.weights
    tree = cKDTree(points, balanced_tree=False)
    layout = Layout.of(tree, normals)
    grid = Grid.around(points, _cell(points, layout, options))
    _refuse_too_fine(layout, grid.cell_mm, options)
    tell("measuring density", 0.05)
    areas = areas_of(grid, points)
    held_points, held_normals, held_areas = points, normals, areas
    foot = foot_height(points)
    stands = options.is_closed and options.has_flat_base
    if stands:
        if np.percentile(points[:, 2], 99.0) < foot + _LEAST_CELLS * grid.cell_mm:
            raise SurfaceError(
                "All points lie in one flat layer.", "Make an open mesh, or scan from more sides."
            )
        base = footprint(grid, points, normals, foot)
        held_points = np.concatenate([points, base])
        held_normals = np.concatenate([normals, np.tile([0.0, 0.0, -1.0], (len(base), 1))])
        held_areas = np.concatenate([areas, np.full(len(base), grid.cell_mm**2)])
    tell("solving", 0.15)
    field = solve_indicator(grid, held_points, held_normals, held_areas)
    field -= level_of(grid, field, points, areas)
    if stands:
        # Cut off below the foot: a field that falls by one in a cell crosses zero just there.
        heights = grid.origin[2] + np.arange(grid.shape[2]) * grid.cell_mm
        np.minimum(field, ((heights - foot) / grid.cell_mm).astype(np.float32), out=field)
    # Whatever the points leave open must not run out of the grid.
    for axis in range(3):
        for side in (0, -1):
            edge = np.moveaxis(field, axis, 0)[side]
            np.minimum(edge, -1e-3, out=edge)
    tell("finding the surface", 0.55)
    mesh, outward = contour(grid, field, 0.0)
    del field
    if not len(mesh):
        raise SurfaceError("The points do not close around anything.", "Scan the thing from all sides.")
    tell("fitting to the points", 0.7)
    vertices = snap(
        mesh.vertices.astype(np.float64), outward, tree, normals, weights, _SNAP_CELLS * grid.cell_mm
    )
    if stands:
        vertices[:, 2] = np.maximum(vertices[:, 2], foot)
    tell("colouring", 0.9)
    made = TriangleMesh(vertices.astype(np.float32), mesh.faces, colours_at(vertices, tree, usable.colours))
    if not options.is_closed:
        made = _trimmed(made, tree, options.trim_mm or _TRIM_CELLS * grid.cell_mm)
    made = without_islands(welded(made), options.island_share)
    if not len(made):
        raise SurfaceError(
            "The points lie too far apart for a surface between them.", "Take a coarser detail."
        )
    if not options.is_closed and options.hole_mm:
        made = fill_holes(made, options.hole_mm)
    tell("leaving out triangles", 0.93)
    if options.tolerance_mm is not None:
        made = to_tolerance(made, options.tolerance_mm)
    if options.triangles is not None:
        made = to_count(made, options.triangles)
    tell("done", 1.0)
    return made


@dataclass(frozen=True, eq=False, slots=True)
class _Usable:
    """Points that can be used: (N, 3) mm, (N, 3) unit vectors, (N,) by their variance, (N, 3)."""

    points: Points
    normals: Points
    weights: Floats
    colours: NDArray[np.uint8]


def _usable(cloud: PointCloud) -> _Usable:
    lengths = np.linalg.norm(cloud.normals, axis=1)
    is_usable = np.isfinite(cloud.points).all(axis=1) & (np.abs(lengths - 1.0) < 0.1)
    if np.count_nonzero(is_usable) < _FEWEST_POINTS:
        raise SurfaceError(
            f"Only {np.count_nonzero(is_usable)} points have a normal; a surface needs {_FEWEST_POINTS}.",
            "Look whether they lie on a surface and not on lines.",
        )
    points = cloud.points[is_usable].astype(np.float64)
    extent = float(np.ptp(points, axis=0).max())
    if extent > _LARGEST_MM:
        raise SurfaceError(
            f"The points lie up to {extent:.2g} mm apart; a surface may be {_LARGEST_MM:.0g} mm wide.",
            "Look in which unit the file is, or remove what lies far away.",
        )
    if extent < 1e-3:
        raise SurfaceError("All points lie in one place.", "Look at the cloud in the 3D view.")
    normals = cloud.normals[is_usable] / lengths[is_usable, None]
    sigma = cloud.sigma_mm[is_usable].astype(np.float64)
    usual = float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else 1.0
    sigma = np.clip(np.where(np.isfinite(sigma), sigma, usual), 0.2 * usual, None)
    return _Usable(points, normals.astype(np.float64), (usual / sigma) ** 2, cloud.colours[is_usable])


def _refuse_too_fine(layout: Layout, cell_mm: float, options: MeshOptions) -> None:
    """What lies between points may be guessed where they tell which way it goes, but not at any distance."""
    if not options.is_closed:
        # Discs of the trimmed width around points that lie further apart do not touch.
        most_mm = 2.0 * (options.trim_mm or _TRIM_CELLS * cell_mm)
    elif layout.is_strewn:
        most_mm = _STREWN_CELLS * cell_mm
    else:
        most_mm = _MOST_SPACING_CELLS * cell_mm
    spacing = layout.spacing_mm
    if spacing > most_mm:
        raise SurfaceError(
            f"The points lie about {spacing:.3g} mm apart: too few for a detail of {cell_mm:.3g} mm.",
            f"Take a coarser detail, such as {_CELL_SPACINGS * spacing:.2g} mm, or scan more points.",
        )


def _cell(points: Points, layout: Layout, options: MeshOptions) -> float:
    """The size of a cell that was asked for, or that the points' spacing allows, within the most cells."""
    wanted = options.cell_mm or max(_CELL_SPACINGS * layout.spacing_mm, 1e-3)
    smallest = Grid.around(points, float(np.ptp(points, axis=0).max()) / 40.0)
    volume = smallest.cells * smallest.cell_mm**3
    return max(wanted, 1.1 * math.cbrt(volume / options.most_cells))


def _trimmed(mesh: TriangleMesh, tree: cKDTree, farthest_mm: float) -> TriangleMesh:
    """Without the triangles that reach where no points are."""
    distances, _ = tree.query(mesh.vertices, workers=-1)
    is_near = np.asarray(distances <= farthest_mm)
    faces = mesh.faces[is_near[mesh.faces].all(axis=1)]
    return with_faces(mesh, faces)
