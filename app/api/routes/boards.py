"""Calibration boards to print, and how the bench's own is described."""

from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from app.api.services import Served, Services
from app.calibration.board_print import RULER_MM, draw_board
from app.calibration.page import Paper, pdf_bytes, svg_bytes
from app.recording.manifest_facts import BoardFacts, board_json
from app.vision.board import BoardKind, BoardSpec

router = APIRouter(prefix="/boards", tags=["calibrate"])
# What suits a table of 180 mm and either paper.
_USUAL = BoardSpec("chessboard", 11, 8, 12.0)


class BoardOut(BaseModel):
    """A board.

    Attributes:
        board: as the bench file and `POST /calibrate` take it.
        description: for people.
        is_of_bench: whether the bench names it; else it is one that suits most.
        ruler_mm: length of the ruler that is printed with it.
    """

    board: BoardFacts
    description: str
    is_of_bench: bool
    ruler_mm: float


class PrintIn(BaseModel):
    """A board to print; the bench's own, or one that suits most, where nothing is said."""

    kind: BoardKind | None = None
    columns: Annotated[int, Field(ge=2, le=100)] = 11
    rows: Annotated[int, Field(ge=2, le=100)] = 8
    spacing_mm: Annotated[float, Field(gt=0.0, le=1000.0)] = 12.0
    marker_mm: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    dictionary: Annotated[str, Field(max_length=40)] = "DICT_4X4_50"
    paper: Paper = "a4"

    def spec(self, served: Services) -> BoardSpec:
        """Raises OptionError for a board that cannot be."""
        if self.kind is None:
            return _of_bench(served)[0]
        is_charuco = self.kind == "charuco"
        spec = BoardSpec(
            self.kind, self.columns, self.rows, self.spacing_mm,
            (self.marker_mm or 0.75 * self.spacing_mm) if is_charuco else 0.0,
            self.dictionary if is_charuco else "",
        )  # fmt: skip
        spec.check()
        return spec


Print = Annotated[PrintIn, Query()]


@router.get("/board.json")
def show_board(served: Served) -> BoardOut:
    """The board that is used."""
    spec, is_of_bench = _of_bench(served)
    return BoardOut.model_validate(
        {
            "board": board_json(spec),
            "description": spec.description,
            "is_of_bench": is_of_bench,
            "ruler_mm": RULER_MM,
        }
    )


@router.get("/print.pdf", response_class=Response)
def print_pdf(served: Served, wanted: Print) -> Response:
    """A page to print at 100 %, with a ruler to check the printer by."""
    data = pdf_bytes(draw_board(wanted.spec(served)), wanted.paper)
    headers = {"Content-Disposition": 'attachment; filename="turnscan-board.pdf"'}
    return Response(data, media_type="application/pdf", headers=headers)


@router.get("/print.svg", response_class=Response)
def print_svg(served: Served, wanted: Print) -> Response:
    """The same as a picture, also to look at."""
    return Response(svg_bytes(draw_board(wanted.spec(served))), media_type="image/svg+xml")


def _of_bench(served: Services) -> tuple[BoardSpec, bool]:
    if served.bench.description.board is not None:
        return served.bench.description.board.spec(), True
    if served.bench.world is not None:
        return served.bench.world.stage.board, True
    return _USUAL, False
