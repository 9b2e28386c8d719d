"""Reading the vertices of any PLY file, however it was made."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.errors import PointCloudFileError
from app.files import reason
from app.geometry.cloud import PointCloud

_LONGEST_LINE = 65_536
_MOST_LINES = 10_000
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_LASER_COMMENT = "laser "
# Rounding makes no more; other programs leave the area of a triangle in a normal's length.
_UNIT_WITHIN = 1e-3
_LINES_AT_ONCE = 65_536
_Columns: TypeAlias = dict[str, NDArray[np.generic]]


@dataclass(slots=True)
class _Property:
    name: str
    type: str
    is_list: bool


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


@dataclass(slots=True)
class _Header:
    order: str
    elements: list[_Element]
    laser_names: tuple[str, ...]


def read_ply(path: Path, *, allows_nowhere: bool = False) -> PointCloud:
    """The vertices of a PLY file; faces and everything else are passed over.

    Only x, y and z must be there. Missing normals are zero, missing colours 200 grey, a missing sigma NaN, a
    missing quality one. Normals of another length are made unit vectors. Colours stored as floats are taken
    to run from 0 to 1, as 16 bits to 65535.

    Args:
        path: of the file.
        allows_nowhere: see `PlyFile.pieces`.

    Raises:
        PointCloudFileError: it is no PLY file, is cut short, or a position is not finite.
    """
    return next(iter(PlyFile.open(path).pieces(None, allows_nowhere=allows_nowhere)))


def ply_points(path: Path) -> int:
    """How many vertices a PLY file promises: its header is read, nothing else.

    Raises:
        PointCloudFileError: it is no PLY file.
    """
    return PlyFile.open(path).points


@dataclass(frozen=True, slots=True)
class PlyFile:
    """A PLY file whose header was read.

    Attributes:
        path: of the file.
        points: vertices that it promises.
        laser_names: what `laser` counts.
        is_text: whether its numbers are text.
    """

    path: Path
    points: int
    laser_names: tuple[str, ...]
    is_text: bool

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read the header.

        Raises:
            PointCloudFileError: it is no PLY file.
        """
        try:
            with path.open("rb") as file:
                header = _read_header(file, path)
        except OSError as error:
            raise PointCloudFileError(str(path), reason(error)) from error
        points = next((element.count for element in header.elements if element.name == "vertex"), 0)
        return cls(path, points, header.laser_names, not header.order)

    def pieces(self, most: int | None = 65_536, *, allows_nowhere: bool = False) -> Iterator[PointCloud]:
        """The vertices as `read_ply` has them, at most so many at a time, so that any file goes through.

        Args:
            most: vertices at a time; all at once for None.
            allows_nowhere: positions may be not finite, as other programs write them for pixels without one.

        Raises:
            PointCloudFileError: as `read_ply`, in the piece where it shows.
        """
        done = 0
        try:
            with self.path.open("rb") as file:
                header = _read_header(file, self.path)
                for columns in _read_columns(file, header, self.path, most):
                    cloud = _cloud(columns, header.laser_names)
                    if not allows_nowhere:
                        _refuse_nowhere(cloud, self.path, done)
                    yield cloud
                    done += len(cloud)
        except OSError as error:
            raise PointCloudFileError(str(self.path), reason(error)) from error


def _read_header(file: BinaryIO, path: Path) -> _Header:
    if file.readline(16).strip() != b"ply":
        raise PointCloudFileError(str(path), "is no PLY file (its first line is not `ply`)")
    order: str | None = None
    elements: list[_Element] = []
    lasers: list[str] = []
    for _ in range(_MOST_LINES):
        raw = file.readline(_LONGEST_LINE)
        if not raw.endswith(b"\n"):
            break
        words = raw.decode("latin-1").split()
        if not words:
            continue
        match words[0]:
            case "end_header":
                if order is None:
                    raise PointCloudFileError(str(path), "its header names no format")
                return _Header(order, elements, tuple(lasers))
            case "comment" | "obj_info":
                text = " ".join(words[1:])
                if text.startswith(_LASER_COMMENT) and len(words) > 3 and words[2] == str(len(lasers)):
                    lasers.append(" ".join(words[3:]))
            case "format":
                order = _format(words, path)
            case "element":
                elements.append(_element(words, path))
            case "property":
                if not elements:
                    raise PointCloudFileError(str(path), "its header has a property before any element")
                elements[-1].properties.append(_property(words, path))
            case other:
                raise PointCloudFileError(str(path), f"its header has an unknown line {other[:40]!r}")
    raise PointCloudFileError(str(path), "its header never ends")


def _format(words: list[str], path: Path) -> str:
    if len(words) != 3 or words[1] not in _FORMATS:
        raise PointCloudFileError(str(path), f"has the unknown format {' '.join(words[1:])[:40]!r}")
    return _FORMATS[words[1]]


def _element(words: list[str], path: Path) -> _Element:
    if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or len(words[2]) > 15:
        raise PointCloudFileError(str(path), f"does not say how many {' '.join(words[1:2])[:40]!r} it has")
    return _Element(words[1], int(words[2]), [])


def _property(words: list[str], path: Path) -> _Property:
    is_list = len(words) == 5 and words[1] == "list"
    if not is_list and len(words) != 3:
        raise PointCloudFileError(str(path), f"has a malformed property {' '.join(words[1:])[:40]!r}")
    unknown = [name for name in words[2 if is_list else 1 : -1] if name not in _TYPES]
    if unknown:
        raise PointCloudFileError(str(path), f"has a property of the unknown type {unknown[0][:40]!r}")
    return _Property(words[-1], _TYPES[words[-2]], is_list)


def _read_columns(file: BinaryIO, header: _Header, path: Path, most: int | None) -> Iterator[_Columns]:
    """Every vertex property by name, at most so many vertices at a time."""
    left = os.fstat(file.fileno()).st_size - file.tell()
    for element in header.elements:
        is_vertex = element.name == "vertex"
        names = [p.name for p in element.properties]
        if any(p.is_list for p in element.properties):
            what = (
                "has lists in its vertices" if is_vertex else f"has its {element.name!r} before its vertices"
            )
            raise PointCloudFileError(str(path), f"{what}, which is not supported")
        if is_vertex and len(set(names)) < len(names):
            raise PointCloudFileError(str(path), "names a property of its vertices twice")
        if is_vertex and not {"x", "y", "z"} <= set(names):
            raise PointCloudFileError(str(path), "has vertices without x, y and z")
        # The shortest text of a number is a digit and a blank.
        size = sum(2 if not header.order else np.dtype(p.type).itemsize for p in element.properties)
        if element.count * size > left + (not header.order):
            problem = f"promises {element.count} of {element.name!r}, but is too short for them"
            raise PointCloudFileError(str(path), problem)
        if header.order:
            left -= element.count * size
            if not is_vertex:
                file.seek(element.count * size, os.SEEK_CUR)
                continue
            yield from _binary_columns(file, element, header.order, path, most)
            return
        if is_vertex:
            yield from _text_columns(file, element, path, most)
            return
        for _ in range(element.count):
            if not _line(file, path):
                break
    raise PointCloudFileError(str(path), "has no vertices")


def _binary_columns(
    file: BinaryIO, element: _Element, order: str, path: Path, most: int | None
) -> Iterator[_Columns]:
    layout = np.dtype([(p.name, order + p.type) for p in element.properties])
    for done, wanted in _portions(element.count, most):
        rows = np.fromfile(file, layout, wanted)
        if len(rows) < wanted:
            raise PointCloudFileError(str(path), f"ends after {done + len(rows)} of {element.count} vertices")
        yield {p.name: rows[p.name] for p in element.properties}


def _text_columns(file: BinaryIO, element: _Element, path: Path, most: int | None) -> Iterator[_Columns]:
    width = len(element.properties)
    for first, wanted in _portions(element.count, most):
        table = np.empty((wanted, width))
        for done, rows in _portions(wanted, _LINES_AT_ONCE):
            words: list[bytes] = []
            while len(words) < rows * width:
                line = _line(file, path)
                if not line:
                    problem = f"ends before its {element.count} vertices do"
                    raise PointCloudFileError(str(path), problem)
                words += line.split()
            try:
                table[done : done + rows] = np.array(words, np.float64).reshape(rows, width)
            except ValueError:
                span = f"{first + done} to {first + done + rows - 1}"
                problem = f"has something that is no number among its vertices {span}"
                raise PointCloudFileError(str(path), problem) from None
        yield {p.name: _typed(table[:, k], p, path) for k, p in enumerate(element.properties)}


def _portions(count: int, most: int | None) -> Iterator[tuple[int, int]]:
    """Where each begins and how many it has; one of nothing where there is nothing."""
    step = most or max(count, 1)
    for start in range(0, max(count, 1), step):
        yield start, min(step, count - start)


def _line(file: BinaryIO, path: Path) -> bytes:
    """The next line of numbers; empty at the end of the file."""
    line = file.readline(_LONGEST_LINE)
    if len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
        raise PointCloudFileError(str(path), "has a line that is too long")
    return line


def _typed(values: NDArray[np.float64], kind: _Property, path: Path) -> NDArray[np.generic]:
    if kind.type.startswith("f"):
        with np.errstate(over="ignore"):
            return values.astype(kind.type)
    limits = np.iinfo(kind.type)
    if not np.all((values >= limits.min) & (values <= limits.max)):
        raise PointCloudFileError(str(path), f"has a value of {kind.name!r} that does not fit its type")
    return values.astype(kind.type)


def _refuse_nowhere(cloud: PointCloud, path: Path, first: int) -> None:
    bad = np.flatnonzero(~np.isfinite(cloud.points).all(axis=1))
    if len(bad):
        raise PointCloudFileError(str(path), f"vertex {first + bad[0]} has a position that is not finite")


def _cloud(columns: _Columns, lasers: tuple[str, ...]) -> PointCloud:
    n = len(columns["x"])

    def floats(name: str, missing: float) -> NDArray[np.float32]:
        if name not in columns:
            return np.full(n, missing, np.float32)
        with np.errstate(over="ignore"):
            return columns[name].astype(np.float32)

    def colour(name: str) -> NDArray[np.uint8]:
        values = columns.get(name, np.full(n, 200, np.uint8))
        scale = {"f": 255.0, "u": 255.0 / np.iinfo(np.uint16).max}
        if values.dtype == np.uint8:
            return values.astype(np.uint8)
        factor = scale[values.dtype.kind] if values.dtype.kind == "f" or values.dtype == np.uint16 else 1.0
        mixed = np.nan_to_num(values.astype(np.float64) * factor, nan=0.0)
        return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)

    points = np.column_stack([floats(name, 0.0) for name in "xyz"])
    normals = np.column_stack([floats(name, 0.0) for name in ("nx", "ny", "nz")])
    normals[~np.isfinite(normals).all(axis=1)] = 0.0
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1)
    is_odd = (np.abs(lengths - 1.0) > _UNIT_WITHIN) & (lengths > 0.0)
    normals[is_odd] = normals[is_odd] / lengths[is_odd, None]
    colours = np.column_stack([colour(name) for name in ("red", "green", "blue")])
    laser = np.clip(np.nan_to_num(floats("laser", 0.0)), 0, 255).astype(np.uint8)
    return PointCloud(
        points, normals, colours, floats("sigma_mm", float("nan")), laser, floats("angle_deg", 0.0),
        floats("quality", 1.0), lasers,
    )  # fmt: skip
