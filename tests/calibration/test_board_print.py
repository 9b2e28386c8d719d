"""Printed boards are exact in size, can be read back by the detector, and say what they are."""

import re
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import cv2
import numpy as np
import pypdfium2
import pytest
from numpy.testing import assert_allclose

from app.calibration.board_print import draw_board, draw_platter, print_board, print_platter, write_svg
from app.calibration.drawing import Rectangle, Ring, Text
from app.calibration.page import PAPERS_MM, Paper
from app.errors import OptionError, OutputError
from app.vision.board import BoardSpec, detect_board
from app.vision.markers import PlatterSpec, detect_markers

CHESSBOARD = BoardSpec("chessboard", 9, 6, 25.0)
BOARDS = [
    CHESSBOARD,
    BoardSpec("charuco", 5, 7, 30.0, 20.0, "DICT_6X6_250"),
    BoardSpec("charuco", 6, 8, 25.0, 18.5, "DICT_4X4_50"),
    BoardSpec("circles", 7, 5, 20.0),
    BoardSpec("asymmetric_circles", 4, 11, 15.0),
]
PLATTER = PlatterSpec("DICT_4X4_50", 25.0, (0, 1, 2, 3, 4, 5, 6, 7))
PAPERS: tuple[Paper, ...] = get_args(Paper)


def page_picture(path: Path, dots_per_inch: float = 150.0) -> tuple[np.ndarray, np.ndarray]:
    """The page as pixels, and mm per pixel each way: the renderer rounds the page up to whole pixels."""
    page = pypdfium2.PdfDocument(path)[0]
    image = cv2.cvtColor(page.render(scale=dots_per_inch / 72.0).to_numpy(), cv2.COLOR_BGR2GRAY)
    return np.asarray(image), np.array(page.get_size()) / 72.0 * 25.4 / image.shape[::-1]


def subpath_rectangles(svg: bytes) -> np.ndarray:
    """Every rectangle of the one path: x, y, width, height."""
    number = r"(-?[\d.]+)"
    pattern = rf"M{number} {number}h{number}v{number}h-[\d.]+z".encode()
    return np.array(re.findall(pattern, svg)).astype(float)


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("spec", BOARDS, ids=lambda spec: spec.description)
def test_a_printed_board_is_found_on_its_page_at_its_true_size(
    spec: BoardSpec, paper: Paper, tmp_path: Path
) -> None:
    print_board(spec, tmp_path / "board.pdf", paper)
    image, mm_per_px = page_picture(tmp_path / "board.pdf")
    seen = detect_board(image, spec)
    assert len(seen.ids) == len(spec.points())
    on_page = (seen.corners + 0.5) * mm_per_px
    terms = np.column_stack([seen.board_points[:, :2], np.ones(len(seen.ids))])
    affine = np.linalg.lstsq(terms, on_page, rcond=None)[0]
    assert_allclose(affine[:2], np.eye(2), atol=1e-3)
    assert np.abs(terms @ affine - on_page).max() < 0.03


@pytest.mark.parametrize("paper", PAPERS)
def test_the_page_is_the_paper_upright_or_lying(paper: Paper, tmp_path: Path) -> None:
    sizes = []
    for spec in (CHESSBOARD, BoardSpec("chessboard", 6, 8, 20.0)):
        print_board(spec, tmp_path / "board.pdf", paper)
        sizes.append(np.array(pypdfium2.PdfDocument(tmp_path / "board.pdf")[0].get_size()) / 72.0 * 25.4)
    assert_allclose(sizes, [PAPERS_MM[paper][::-1], PAPERS_MM[paper]], atol=1e-3)


def test_the_ruler_on_the_page_is_a_hundred_millimetres_long(tmp_path: Path) -> None:
    print_board(CHESSBOARD, tmp_path / "board.pdf")
    image, mm_per_px = page_picture(tmp_path / "board.pdf", 600.0)
    drawing = draw_board(CHESSBOARD)
    page = PAPERS_MM["a4"][::-1]
    top = (page[1] - drawing.height_mm) / 2.0 + drawing.ruler[1]
    # A row of pixels that only the ticks of every full centimetre reach.
    ink = 255.0 - image[round((top + 3.4) / mm_per_px[1])]
    edges = np.flatnonzero(np.diff((ink > 127).astype(int)))
    middles = edges.reshape(-1, 2).mean(axis=1) + 0.5
    assert len(middles) == 11
    assert_allclose(np.diff(middles) * mm_per_px[0], 10.0, atol=0.05)
    assert_allclose((middles[-1] - middles[0]) * mm_per_px[0], 100.0, atol=0.05)


def test_an_svg_is_measured_in_millimetres(tmp_path: Path) -> None:
    write_svg(draw_board(CHESSBOARD), tmp_path / "board.svg")
    root = ElementTree.parse(tmp_path / "board.svg").getroot()
    _, _, width, height = (float(value) for value in root.attrib["viewBox"].split())
    assert root.attrib["width"] == f"{width:g}mm"
    assert root.attrib["height"] == f"{height:g}mm"
    rectangles = subpath_rectangles((tmp_path / "board.svg").read_bytes())
    squares = rectangles[rectangles[:, 3] == 25.0]
    assert len(squares) == 35
    assert_allclose(squares[:, 2], 25.0)
    assert_allclose(np.ptp(squares[:, :2], axis=0), [225.0, 150.0])
    ticks = rectangles[(rectangles[:, 2] == 0.2) & (rectangles[:, 3] > 1.0)]
    assert len(ticks) == 101
    assert_allclose(np.diff(np.sort(ticks[:, 0])), 1.0, atol=1e-4)


def test_dots_of_an_svg_lie_where_the_detector_expects_them(tmp_path: Path) -> None:
    spec = BOARDS[-1]
    print_board(spec, tmp_path / "board.svg")
    circles = ElementTree.parse(tmp_path / "board.svg").getroot().iter("{http://www.w3.org/2000/svg}circle")
    centres = np.array([[float(c.attrib["cx"]), float(c.attrib["cy"])] for c in circles])
    assert_allclose(centres - centres[0], spec.points()[:, :2], atol=1e-4)


def test_the_page_says_what_it_is_and_how_to_print_it() -> None:
    lines = [shape.text for shape in draw_board(CHESSBOARD).shapes if isinstance(shape, Text)]
    assert lines[0] == "100 mm: measure me. Print at 100 %, no fit-to-page."
    assert lines[1] == "chessboard 9 x 6, 25 mm, counted in inner corners"


def test_nothing_of_a_drawing_lies_outside_of_its_size() -> None:
    for drawing in [*(draw_board(spec) for spec in BOARDS), draw_platter(PLATTER, 180.0)]:
        for shape in drawing.shapes:
            if isinstance(shape, Rectangle):
                assert shape.x_mm >= -1e-9
                assert shape.y_mm >= -1e-9
                assert shape.x_mm + shape.width_mm <= drawing.width_mm + 1e-9
                assert shape.y_mm + shape.height_mm <= drawing.height_mm


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("spec", [BoardSpec("chessboard", 11, 8, 25.0), BoardSpec("circles", 20, 9, 15.0)])
def test_a_board_that_is_too_large_names_the_largest_spacing_that_fits(
    spec: BoardSpec, paper: Paper, tmp_path: Path
) -> None:
    with pytest.raises(OptionError) as refused:
        print_board(spec, tmp_path / "board.pdf", paper)
    named = re.search(r"largest spacing that fits is ([\d.]+) mm", refused.value.hint)
    assert named
    assert not list(tmp_path.iterdir())
    largest = float(named[1])
    print_board(BoardSpec(spec.kind, spec.columns, spec.rows, largest), tmp_path / "board.pdf", paper)
    with pytest.raises(OptionError):
        print_board(BoardSpec(spec.kind, spec.columns, spec.rows, largest + 0.11), tmp_path / "b.pdf", paper)


def test_a_platter_sheet_shows_its_markers_at_their_true_size(tmp_path: Path) -> None:
    print_platter(PLATTER, 180.0, tmp_path / "platter.pdf")
    image, mm_per_px = page_picture(tmp_path / "platter.pdf")
    seen = detect_markers(image, PLATTER)
    assert tuple(seen.ids) == PLATTER.ids
    sides = np.linalg.norm(np.diff(seen.corners[:, [0, 1, 2, 3, 0]] * mm_per_px, axis=1), axis=2)
    assert_allclose(sides, 25.0, atol=0.1)
    rings = [shape for shape in draw_platter(PLATTER, 180.0).shapes if isinstance(shape, Ring)]
    assert rings[0].radius_mm + rings[0].line_mm / 2.0 == 90.0


def test_markers_that_do_not_fit_on_the_rim_are_refused() -> None:
    with pytest.raises(OptionError, match="do not fit"):
        draw_platter(PLATTER, 90.0)


def test_another_ending_is_refused_and_a_missing_folder_named(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"board\.png"):
        print_board(CHESSBOARD, tmp_path / "board.png")
    with pytest.raises(OutputError, match="nowhere"):
        print_board(CHESSBOARD, tmp_path / "nowhere" / "board.pdf")
