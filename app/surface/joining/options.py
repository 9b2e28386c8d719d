"""How scans are to be joined."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

Place = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
"""x, y, z in mm."""


class PairedPlaces(BaseModel):
    """One place of the thing, shown in two scans.

    Attributes:
        cloud: number of the scan that is to be placed; 0 is the first one.
        here: where the place is in that scan.
        there: where it is in the first scan.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    cloud: Annotated[int, Field(ge=1)]
    here: Place
    there: Place


class JoinOptions(BaseModel):
    """What a person may say about a join; everything has a usual value.

    Attributes:
        cell_mm: edge of the cells of which the fine alignment takes one point each; by the points' own
            spacing where it is not given.
        pairs: three or more of one scan say where it lies, and it is not searched.
        is_fused: where scans lie on each other, their points are averaged; otherwise all are kept.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    cell_mm: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    pairs: tuple[PairedPlaces, ...] = ()
    is_fused: bool = True
