"""The parts of `recording.json` that are said once: camera, lasers, turntable, board, platter."""

from typing import Annotated, Literal, TypeAlias

import cv2
from pydantic import Field, StringConstraints, field_validator, model_validator

from app.documents import Entry, Json
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour

LARGEST = 10**9
Direction: TypeAlias = Literal["ccw", "cw"]
Millimetres = Annotated[float, Field(gt=0.0, le=1e6)]
PixelCount = Annotated[int, Field(gt=0, le=65535)]
Count = Annotated[int, Field(ge=2, le=1000)]
Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class CameraFacts(Entry):
    """Pixels of every frame."""

    width: PixelCount
    height: PixelCount
    name: str | None = None


class LaserFacts(Entry):
    """One laser of the rig."""

    name: Name
    colour: LaserColour


class TurntableFacts(Entry):
    """Which way the table turns as `angle_deg` grows, seen from above; how fast, where it turns steadily."""

    direction: Direction
    seconds_per_turn: Annotated[float, Field(gt=0.0, le=LARGEST)] | None = None


class ChessboardFacts(Entry):
    """Counted in inner corners."""

    kind: Literal["chessboard"]
    columns: Count
    rows: Count
    square_mm: Millimetres

    def spec(self) -> BoardSpec:
        return BoardSpec(self.kind, self.columns, self.rows, self.square_mm)


class CharucoFacts(Entry):
    """Counted in squares."""

    kind: Literal["charuco"]
    columns: Count
    rows: Count
    square_mm: Millimetres
    marker_mm: Millimetres
    dictionary: str

    @field_validator("dictionary")
    @classmethod
    def _is_known(cls, name: str) -> str:
        return _known_dictionary(name)

    @model_validator(mode="after")
    def _marker_fits(self) -> "CharucoFacts":
        if self.marker_mm >= self.square_mm:
            raise ValueError(
                f"marker_mm must be smaller than square_mm, but {self.marker_mm:g} >= {self.square_mm:g}"
            )
        return self

    def spec(self) -> BoardSpec:
        return BoardSpec(self.kind, self.columns, self.rows, self.square_mm, self.marker_mm, self.dictionary)


class CirclesFacts(Entry):
    """Counted in dots."""

    kind: Literal["circles", "asymmetric_circles"]
    columns: Count
    rows: Count
    spacing_mm: Millimetres

    def spec(self) -> BoardSpec:
        return BoardSpec(self.kind, self.columns, self.rows, self.spacing_mm)


BoardFacts = Annotated[ChessboardFacts | CharucoFacts | CirclesFacts, Field(discriminator="kind")]


class PlatterFacts(Entry):
    """ArUco markers fixed on the table; where they lie is unknown."""

    kind: Literal["aruco"]
    dictionary: str
    marker_mm: Millimetres
    ids: Annotated[tuple[Annotated[int, Field(ge=0, le=100_000)], ...], Field(min_length=1, max_length=1000)]

    @field_validator("dictionary")
    @classmethod
    def _is_known(cls, name: str) -> str:
        return _known_dictionary(name)

    @field_validator("ids")
    @classmethod
    def _are_different(cls, ids: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(ids)) < len(ids):
            raise ValueError("names a marker twice")
        return ids

    def spec(self) -> PlatterSpec:
        return PlatterSpec(self.dictionary, self.marker_mm, self.ids)


def board_json(board: BoardSpec) -> Json:
    """The board as the manifest has it."""
    facts: Json = {"kind": board.kind, "columns": board.columns, "rows": board.rows}
    if board.kind in ("circles", "asymmetric_circles"):
        return facts | {"spacing_mm": board.spacing_mm}
    facts["square_mm"] = board.spacing_mm
    if board.kind == "charuco":
        facts |= {"marker_mm": board.marker_mm, "dictionary": board.dictionary}
    return facts


def platter_json(platter: PlatterSpec) -> Json:
    """The platter as the manifest has it."""
    return {
        "kind": "aruco", "dictionary": platter.dictionary, "marker_mm": platter.marker_mm,
        "ids": list(platter.ids),
    }  # fmt: skip


def _known_dictionary(name: str) -> str:
    if not (name.startswith("DICT_") and isinstance(getattr(cv2.aruco, name, None), int)):
        raise ValueError(f"there is no ArUco dictionary called {name!r}")
    return name
