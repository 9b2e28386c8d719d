"""Fields as Horus and FabScanPi write them, and what both mean by them."""

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from app.calibration.record_file import Number, Triple, check_camera_matrix, check_unit

_ROTATION_TOLERANCE = 1e-3
_TRUTH = {"true": True, "false": False}


def _flat(value: Any) -> Any:
    """Numbers of a list in whatever brackets numpy put them; anything else as it is."""
    return tuple(_numbers(value)) if isinstance(value, list) else value


def _numbers(value: list[Any]) -> Iterator[Any]:
    for inner in value:
        if isinstance(inner, list):
            yield from _numbers(inner)
        else:
            yield inner


def _truth(value: Any) -> Any:
    """FabScanPi writes "True" and "False" in quotes."""
    return _TRUTH.get(value.lower(), value) if isinstance(value, str) else value


def _is_normal(normal: tuple[float, ...]) -> tuple[float, ...]:
    if any(normal):
        if len(normal) != 3:
            raise ValueError(f"must have 3 numbers, not {len(normal)}")
        check_unit((normal[0], normal[1], normal[2]))
    return normal


def _is_place(place: tuple[float, ...]) -> tuple[float, ...]:
    if len(place) not in (0, 3):
        raise ValueError(f"must have 3 numbers, not {len(place)}")
    return place


def _is_rotation(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if any(numbers):
        if len(numbers) != 9:
            raise ValueError(f"must have 3 x 3 numbers, not {len(numbers)}")
        matrix = np.array(numbers).reshape(3, 3)
        if not np.allclose(matrix @ matrix.T, np.eye(3), rtol=0.0, atol=_ROTATION_TOLERANCE):
            raise ValueError("is no rotation: its rows must be unit vectors at right angles")
        if np.linalg.det(matrix) < 0.0:
            raise ValueError("is a reflection and no rotation: its determinant is -1")
    return numbers


def _is_lens(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if len(numbers) not in (0, 4, 5):
        raise ValueError(f"must have 5 numbers (k1, k2, p1, p2, k3), not {len(numbers)}")
    return numbers


def _is_matrix(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if numbers:
        if len(numbers) != 9:
            raise ValueError(f"must have 3 x 3 numbers, not {len(numbers)}")
        check_camera_matrix(camera_rows(numbers))
    return numbers


def camera_rows(numbers: tuple[float, ...]) -> tuple[Triple, Triple, Triple]:
    """Nine numbers as three rows."""
    a, b, c, d, e, f, g, h, i = numbers
    return (a, b, c), (d, e, f), (g, h, i)


_Numbers = Annotated[tuple[Number, ...], BeforeValidator(_flat)]

Truth = Annotated[bool, BeforeValidator(_truth)]
CameraMatrix = Annotated[_Numbers, AfterValidator(_is_matrix)]
"""Nine numbers, or none where there is no calibration."""
Lens = Annotated[_Numbers, AfterValidator(_is_lens)]
"""k1, k2, p1, p2 and, mostly, k3; or none."""
Normal = Annotated[_Numbers, AfterValidator(_is_normal)]
"""A unit vector; zeros or nothing where there is no calibration."""
Place = Annotated[_Numbers, AfterValidator(_is_place)]
"""Three numbers, mm, or none."""
Rotation = Annotated[_Numbers, AfterValidator(_is_rotation)]
"""Nine numbers, row by row; zeros or nothing where there is no calibration."""
