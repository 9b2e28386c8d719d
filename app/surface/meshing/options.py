"""What sort of mesh is wanted."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class MeshOptions(BaseModel):
    """How points become triangles.

    Attributes:
        cell_mm: size of the finest detail, about the length of a triangle's edge; the points' own spacing
            where it is not given, but never more cells than `most_cells`.
        most_cells: of the grid; sets memory (about 60 bytes each) and time.
        is_closed: watertight; otherwise the mesh ends where the points end.
        has_flat_base: stands on a plane, at the height of the lowest points; closed meshes only.
        trim_mm: an open mesh ends so far from the nearest point; two cells where it is not given.
        hole_mm: holes of an open mesh that are no wider are closed; 0 for none.
        island_share: pieces with less than this share of the largest one's area are left out.
        triangles: most that are wanted; all where it is not given.
        tolerance_mm: leave out triangles as long as the surface stays within this of where it was.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    cell_mm: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    most_cells: Annotated[int, Field(ge=1_000, le=60_000_000)] = 20_000_000
    is_closed: bool = True
    has_flat_base: bool = True
    trim_mm: Annotated[float, Field(gt=0.0)] | None = None
    hole_mm: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    island_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    triangles: Annotated[int, Field(ge=4)] | None = None
    tolerance_mm: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
