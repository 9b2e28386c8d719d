"""A cloud as bytes or as text, whichever way it is kept."""

from collections.abc import Generator
from pathlib import Path
from typing import Literal, TypeAlias

from app.surface.ply import ply_stream
from app.surface.ply_reader import PlyFile

CloudForm: TypeAlias = Literal["binary", "ascii"]
# Text takes long to make: small pieces let others have their turn.
_AT_ONCE = 4096


def cloud_in_form(path: Path, form: CloudForm) -> Generator[bytes] | None:
    """The file made anew, piece by piece; None where it is kept in that form.

    Raises:
        PointCloudFileError: it is no PLY file.
    """
    file = PlyFile.open(path)
    if file.is_text == (form == "ascii"):
        return None
    return _parts(file, form)


def _parts(file: PlyFile, form: CloudForm) -> Generator[bytes]:
    yield from ply_stream(
        file.pieces(_AT_ONCE), file.points, file.laser_names, ascii_text=form == "ascii"
    )  # fmt: skip
