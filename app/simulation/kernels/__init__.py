"""The renderer's inner loops: compiled where Numba is installed, in NumPy where it is not.

Numba takes a third of a second to import, so that happens when the first loop is wanted.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

IS_COMPILED = find_spec("numba") is not None
LOOPS = (
    "bounds", "curve", "cut", "expose", "light", "near", "paint", "project", "rasterise", "shade", "speckle",
)  # fmt: skip


def __getattr__(name: str) -> Callable[..., Any]:
    if name not in LOOPS:
        raise AttributeError(name)
    loops = import_module(f"{__name__}.{'compiled' if IS_COMPILED else 'plain'}")
    loop: Callable[..., Any] = getattr(loops, name)
    # Found here the next time.
    globals()[name] = loop
    return loop
