"""The files that `turnscan surface` writes: looked at before the work, written after it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.cli.console import check_output
from app.errors import OptionError
from app.files import together
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.exports.textured_obj import beside_obj
from app.surface.exports.units import Unit
from app.surface.exports.write import (
    CLOUD_SUFFIXES,
    MESH_SUFFIXES,
    TEXTURE_SUFFIXES,
    write_cloud,
    write_mesh,
)
from app.surface.texture import Texture


@dataclass(frozen=True, slots=True)
class SurfaceFiles:
    """What is wanted.

    Attributes:
        meshes: each in the form that its ending tells.
        clean, joined: clouds to be kept, too.
        unit: of the meshes' numbers.
        texture_px: of a picture with the colours, for forms that can have one; None for no picture.
    """

    meshes: Sequence[Path]
    clean: Path | None
    joined: Path | None
    unit: Unit
    texture_px: int | None

    def check(self, clouds: Sequence[Path]) -> None:
        """Complain before the work, also where a file would take the place of a cloud or of another.

        Raises:
            OptionError: a name's ending is unknown.
            OutputError: a file cannot be written there.
        """
        _check_form(self.meshes, MESH_SUFFIXES, "mesh")
        _check_form(self._clouds, CLOUD_SUFFIXES, "cloud")
        if self.texture_px is not None and not any(map(self._has_texture, self.meshes)):
            raise OptionError(
                "--texture is for meshes that can have one.",
                f"Name a file that ends in {', '.join(TEXTURE_SUFFIXES)}.",
            )
        taken = list(clouds)
        for path in self.all():
            check_output(path, taken)
            taken.append(path)

    def all(self) -> Iterator[Path]:
        """Every file."""
        for path in self.meshes:
            yield path
            if self._has_texture(path) and path.suffix.lower() == ".obj":
                yield from beside_obj(path)
        yield from self._clouds

    def write(
        self, mesh: TriangleMesh, texture: Texture | None, clean: PointCloud, joined: PointCloud | None
    ) -> None:
        """All of them, or none.

        Raises:
            OutputError: one cannot be written.
        """
        with together(list(self.all())) as beside:
            for path in self.meshes:
                write_mesh(beside[path], mesh, self.unit, texture)
            if self.clean is not None:
                write_cloud(beside[self.clean], clean)
            if self.joined is not None and joined is not None:
                write_cloud(beside[self.joined], joined)

    @property
    def _clouds(self) -> list[Path]:
        return [path for path in (self.clean, self.joined) if path is not None]

    def _has_texture(self, path: Path) -> bool:
        return self.texture_px is not None and path.suffix.lower() in TEXTURE_SUFFIXES


def _check_form(paths: Sequence[Path], known: Sequence[str], what: str) -> None:
    for path in paths:
        if path.suffix.lower() not in known:
            raise OptionError(
                f"{path}: that is no form of a {what}.", f"Name a file that ends in {', '.join(known)}."
            )
