"""The renderer's inner loops: compiled where Numba is installed, in NumPy where it is not."""

from importlib.util import find_spec

IS_COMPILED = find_spec("numba") is not None

if IS_COMPILED:
    from app.simulation.kernels.compiled import (
        curve,
        cut,
        expose,
        light,
        near,
        paint,
        project,
        rasterise,
        resolve,
        shade,
        speckle,
    )
else:
    from app.simulation.kernels.plain import (
        curve,
        cut,
        expose,
        light,
        near,
        paint,
        project,
        rasterise,
        resolve,
        shade,
        speckle,
    )

__all__ = [
    "IS_COMPILED",
    "curve",
    "cut",
    "expose",
    "light",
    "near",
    "paint",
    "project",
    "rasterise",
    "resolve",
    "shade",
    "speckle",
]
