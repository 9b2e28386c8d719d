"""Point clouds as PLY: written while they grow, at the speed of the disk."""

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from app.errors import OutputError
from app.files import reason, replacing
from app.geometry.cloud import PointCloud

VERTEX = np.dtype(
    [
        ("x", "<f4"), ("y", "<f4"), ("z", "<f4"),
        ("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4"),
        ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("laser", "u1"),
        ("sigma_mm", "<f4"), ("angle_deg", "<f4"), ("quality", "<f4"),
    ]
)  # fmt: skip
"""One vertex: 40 bytes, every float at a multiple of four."""

_TYPE_NAMES = {"<f4": "float", "|u1": "uchar"}
_WORDS = VERTEX.itemsize // 4
# Rows that are packed at a time: the buffer stays in the processor's cache.
_CHUNK = 16_384
_COUNT_DIGITS = 12
_SPOOL_BYTES = 16 << 20
_STREAM = "standard output"


class PlyWriter:
    """A PLY file that grows by one cloud after the other; a context manager.

    A path is written beside its place and renamed when the block ends well; nothing is left behind
    otherwise. Nobody waits for the disk to have it: a cloud can be derived again from its recording. A stream
    gets the whole file at the end, because its header needs the number of points: until then the points
    wait in a temporary file.

    Args:
        target: where to, or an open binary stream, which stays open.
        laser_names: what `laser` counts, for the comments.
        ascii_text: numbers as text instead of little-endian binary.

    Raises:
        OutputError: the disk is full or the place cannot be written.
    """

    def __init__(
        self, target: Path | BinaryIO, laser_names: tuple[str, ...] = (), *, ascii_text: bool = False
    ) -> None:
        self.target, self.laser_names, self.ascii_text = target, laser_names, ascii_text
        self.points = 0
        self._open = ExitStack()
        self._file: BinaryIO | None = None
        self._rows = _Rows()

    def __enter__(self) -> Self:
        if isinstance(self.target, Path):
            self._file = self._open.enter_context(replacing(self.target, is_durable=False))
            self._write(self._header())
        else:
            spool = tempfile.SpooledTemporaryFile(max_size=_SPOOL_BYTES)
            self._file = self._open.enter_context(spool)  # type: ignore[assignment]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            try:
                self._finish()
            except BaseException as failure:
                self._open.__exit__(type(failure), failure, failure.__traceback__)
                raise
        self._open.__exit__(kind, error, trace)

    def append(self, cloud: PointCloud) -> None:
        """Add points."""
        for rows in self._rows.of(cloud):
            self._write(_as_text(rows) if self.ascii_text else rows.data)
        self.points += len(cloud)

    def _write(self, data: bytes | memoryview) -> None:
        if self._file is None:
            raise ValueError("the writer is used outside its `with` block")
        try:
            self._file.write(data)
        except OSError as error:
            raise OutputError(self._where, reason(error)) from error

    def _finish(self) -> None:
        assert self._file is not None
        if isinstance(self.target, Path):
            self._file.seek(0)
            self._write(self._header())
            return
        try:
            self._file.seek(0)
            self.target.write(self._header())
            shutil.copyfileobj(self._file, self.target, 1 << 20)
            self.target.flush()
        except OSError as error:
            raise OutputError(self._where, reason(error)) from error

    def _header(self) -> bytes:
        return _header(self.points, self.laser_names, self.ascii_text)

    @property
    def _where(self) -> str:
        return str(self.target) if isinstance(self.target, Path) else _STREAM


def write_ply(target: Path | BinaryIO, cloud: PointCloud, *, ascii_text: bool = False) -> None:
    """A whole cloud at once.

    Raises:
        OutputError: the disk is full or the place cannot be written.
    """
    with PlyWriter(target, cloud.laser_names, ascii_text=ascii_text) as writer:
        writer.append(cloud)


def ply_stream(
    pieces: Iterable[PointCloud], points: int, laser_names: tuple[str, ...] = (), *, ascii_text: bool = False
) -> Iterator[bytes]:
    """What `PlyWriter` would write, in small parts, where it is known how many points will come."""
    yield _header(points, laser_names, ascii_text)
    packing = _Rows()
    for cloud in pieces:
        for rows in packing.of(cloud):
            yield _as_text(rows) if ascii_text else rows.tobytes()


class _Rows:
    """Points as the rows of the file, in a buffer that is used again and again."""

    def __init__(self) -> None:
        self._words = np.zeros((_CHUNK, _WORDS), "<f4")
        self._rows = self._words.view(VERTEX).reshape(_CHUNK)
        self._bytes = self._words.view(np.uint8)

    def of(self, cloud: PointCloud) -> Iterator[NDArray[np.void]]:
        """All points of a cloud; what was given is gone when the next rows are asked for."""
        for start in range(0, len(cloud), _CHUNK):
            yield self._packed(cloud, start, min(start + _CHUNK, len(cloud)))

    def _packed(self, cloud: PointCloud, start: int, stop: int) -> NDArray[np.void]:
        n = stop - start
        words, small = self._words[:n], self._bytes[:n]
        part = slice(start, stop)
        # Column by column: numpy copies rows of three several times slower.
        for k in range(3):
            words[:, k] = cloud.points[part, k]
            words[:, 3 + k] = cloud.normals[part, k]
            small[:, 24 + k] = cloud.colours[part, k]
        small[:, 27] = cloud.laser[part]
        words[:, 7] = cloud.sigma_mm[part]
        words[:, 8] = cloud.angle_deg[part]
        words[:, 9] = cloud.quality[part]
        return self._rows[:n]


def _header(points: int, laser_names: tuple[str, ...], ascii_text: bool) -> bytes:
    """As long for any number of points: a comment takes up what the number leaves."""
    count = str(points)
    lines = [
        "ply",
        f"format {'ascii' if ascii_text else 'binary_little_endian'} 1.0",
        "comment generated by Turnscan",
        "comment unit mm",
        *(f"comment laser {k} {_one_line(name)}" for k, name in enumerate(laser_names)),
        "comment " + "-" * (_COUNT_DIGITS - len(count)),
        f"element vertex {count}",
        *(f"property {_TYPE_NAMES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()),
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode("ascii", "replace")


def _as_text(rows: NDArray[np.void]) -> bytes:
    # Nine digits bring a float32 back exactly.
    line = " ".join("%d" if VERTEX[name].kind == "u" else "%.9g" for name in VERTEX.names or ())
    return "".join(line % row + "\n" for row in rows.tolist()).encode("ascii")


def _one_line(name: str) -> str:
    return " ".join(name.split())
