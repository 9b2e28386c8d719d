"""`turnscan board` and `turnscan platter`: sheets to print."""

from pathlib import Path
from typing import Annotated

import typer

from app.calibration.board_print import print_board, print_platter
from app.calibration.page import Paper
from app.cli.console import check_output, say
from app.cli.words import board_from, platter_from

_Out = Annotated[Path, typer.Option("-o", "--output", help="A .pdf or .svg file.")]
_PaperSize = Annotated[Paper, typer.Option("--paper", help="a4 or letter.")]
_RULER = "Print at 100 %, without fitting to the page, then measure the ruler: it must be 100 mm long."


def board_command(
    board: Annotated[
        str,
        typer.Argument(
            help="KIND:COLUMNSxROWS:MM, such as chessboard:9x6:20 (inner corners), "
            "charuco:7x5:25:18:DICT_4X4_50 (squares), circles:7x6:15, asymmetric_circles:4x11:12."
        ),
    ] = "chessboard:11x8:12",
    output: _Out = Path("board.pdf"),
    paper: _PaperSize = "a4",
) -> None:
    """Print a calibration board at exact scale, with a ruler to check the printer by."""
    check_output(output)
    spec = board_from(board)
    print_board(spec, output, paper)
    say([f"{output}: {board}.", _RULER])


def platter_command(
    markers: Annotated[
        str, typer.Argument(help="DICTIONARY:SIDE_MM:NUMBERS, such as DICT_4X4_50:20:0,1,2,3,4,5.")
    ] = "DICT_4X4_50:20:0,1,2,3,4,5",
    diameter: Annotated[float, typer.Option(help="Diameter of the table, mm.")] = 180.0,
    output: _Out = Path("platter.pdf"),
    paper: _PaperSize = "a4",
) -> None:
    """Print markers to glue on the table: they tell the true angle of every frame."""
    check_output(output)
    print_platter(platter_from(markers), diameter, output, paper)
    say([f"{output}: {markers}.", _RULER])
