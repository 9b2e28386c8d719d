"""A field that is one inside a thing and zero outside, from points with normals.

Poisson surface reconstruction (Kazhdan, Bolitho, Hoppe 2006): the gradient of the indicator is the field of
inward normals. On a regular grid the Poisson equation is solved by one Fourier transform (as in Peng et al.,
"Shape as Points", 2021). Each point counts with the area it stands for, so that a stripe seen twice
pulls no more than one seen once, and the indicator comes out between zero and one.
"""

import math
from os import cpu_count

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfftn, rfftfreq, rfftn
from scipy.ndimage import gaussian_filter

from app.geometry.arrays import Floats, Points
from app.surface.meshing.grid import Grid

# In cells: over how much a point is spread, and over how much density is measured.
_BLUR_CELLS = 0.7
_DENSITY_CELLS = 2.0


def areas_of(grid: Grid, points: Points) -> Floats:
    """(N,) mm^2 that each point stands for, from how densely points lie around it."""
    counts = gaussian_filter(
        grid.splat(points, np.ones((len(points), 1)))[0], _DENSITY_CELLS, mode="constant"
    )
    # A plane with n points a mm^2, blurred across it, has n / (sqrt(2 pi) sigma) a mm^3 at its middle.
    per_mm3 = grid.read(counts, points) / grid.cell_mm**3
    per_mm2 = per_mm3 * math.sqrt(2.0 * math.pi) * _DENSITY_CELLS * grid.cell_mm
    areas: Floats = 1.0 / np.maximum(per_mm2, 1e-12)
    return areas


def solve_indicator(grid: Grid, points: Points, normals: Points, areas: Floats) -> NDArray[np.float32]:
    """The field, one inside and zero outside, as far as the points are closed around it.

    Args:
        grid: where the field is wanted.
        points: (N, 3) mm.
        normals: (N, 3) outward unit vectors.
        areas: (N,) mm^2 that each stands for.
    """
    workers = cpu_count() or 1
    frequencies = [2.0 * np.pi * np.fft.fftfreq(size, grid.cell_mm) for size in grid.shape[:2]]
    frequencies.append(2.0 * np.pi * rfftfreq(grid.shape[2], grid.cell_mm))
    waves = [f.astype(np.float32) for f in frequencies]
    kx, ky, kz = waves[0][:, None, None], waves[1][None, :, None], waves[2][None, None, :]
    spectrum = np.zeros((grid.shape[0], grid.shape[1], len(waves[2])), np.complex64)
    inward = -normals * (areas / grid.cell_mm**3)[:, None]
    for flow, wave in zip(grid.splat(points, inward), (kx, ky, kz), strict=True):
        spectrum += 1j * wave * rfftn(flow, workers=workers)
    squared = kx**2 + ky**2 + kz**2
    squared[0, 0, 0] = 1.0
    blur = np.float32(0.5 * (_BLUR_CELLS * grid.cell_mm) ** 2)
    # laplacian(chi) = div(flow), and the blur keeps the grid from showing.
    spectrum *= -np.exp(-blur * squared) / squared
    spectrum[0, 0, 0] = 0.0
    field: NDArray[np.float32] = irfftn(spectrum, s=grid.shape, workers=workers, overwrite_x=True)
    return field


def level_of(grid: Grid, field: NDArray[np.float32], points: Points, areas: Floats) -> float:
    """The value of the field at the surface: what the points say, each by its area."""
    return float(np.average(grid.read(field, points), weights=areas))
