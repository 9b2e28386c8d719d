"""Stripes in pictures that other people took; what is known of them stands beside the pictures."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.geometry.arrays import Floats
from app.vision.stripe import STRIPE_DETECTORS, Image, LaserStripe, LaserView


def read(path: Path) -> Image:
    image = cv2.imread(str(path))
    assert image is not None, path
    return np.asarray(image, np.uint8)


def off_a_line(stripe: LaserStripe, first: int, last: int, power: int = 1) -> Floats:
    """Residuals of the points between two lines to a smooth curve, those of another surface left out."""
    inside = (stripe.line >= first) & (stripe.line <= last)
    line, across = stripe.line[inside], stripe.pixels[inside, 0]
    near = np.abs(across - np.median(across)) < 40.0
    for _ in range(5):
        curve = np.polynomial.Polynomial.fit(line[near], across[near], power)
        near = np.abs(across - curve(line)) < 2.5
    residuals: Floats = (across - curve(line))[near]
    return residuals


@pytest.mark.parametrize("name", ["zero-crossing", "centroid", "threshold"])
def test_the_statue_has_its_known_rows(shared_data: Path, name: str) -> None:
    folder = shared_data / "ciclop" / "statue"
    view = LaserView(read(folder / "laser.png"), read(folder / "laser_background.png"), "red")
    stripe = STRIPE_DETECTORS.make(name).detect(view)
    # The known 1114 rows, 511 to 778, are whole pixels: the brightest of each row's difference above about 30
    # grey levels. Which of the faintest rows count depends on the detector.
    assert len(stripe) == pytest.approx(1114, abs=10)
    assert stripe.pixels[:, 0].min() == pytest.approx(511, abs=3)
    assert stripe.pixels[:, 0].max() == pytest.approx(778, abs=3)


def test_both_stripes_on_the_board_are_found_and_straight(shared_data: Path) -> None:
    folder = shared_data / "ciclop" / "board"
    lit = read(folder / "laser-0-255-255-8.png")
    dark = read(folder / "laser-background-0-255-255-8.png")
    view = LaserView(lit, dark, "red")
    left, right = STRIPE_DETECTORS.make("zero-crossing").detect_several(view, 2)
    for stripe, middle in ((left, 274.0), (right, 595.0)):
        residuals = off_a_line(stripe, 465, 1010, power=2)
        assert len(residuals) >= 0.85 * 545
        assert residuals.std() < 0.5
        assert np.median(stripe.pixels[:, 0]) == pytest.approx(middle, abs=6)


def test_the_board_has_its_known_rows(shared_data: Path) -> None:
    folder = shared_data / "ciclop" / "board"
    view = LaserView(
        read(folder / "laser-0-255-255-8.png"), read(folder / "laser-background-0-255-255-8.png"), "red"
    )
    stripe = STRIPE_DETECTORS.make("zero-crossing", min_strength=40.0).detect(view)
    # 599 counts the rows brighter than about 40; single ones that lie apart from any stripe, such as the one
    # at x = 873, are no stripe here.
    assert len(stripe) == pytest.approx(599, abs=18)
    assert stripe.pixels[:, 0].min() == pytest.approx(134, abs=2)


def test_the_stripe_across_chessboard_squares_is_found_on_black_and_white(shared_data: Path) -> None:
    folder = shared_data / "stripe-on-board"
    # In pictures 3 and 4 it runs along the edges of squares, where without a partner no estimator is right.
    for number, (first, last) in {0: (75, 340), 1: (75, 340), 2: (70, 300), 5: (85, 300)}.items():
        picture = read(folder / f"{number}_right.jpg")
        stripe = STRIPE_DETECTORS.make("zero-crossing").detect(LaserView(picture, None, "green"))
        residuals = off_a_line(stripe, first, last, power=2)
        assert len(residuals) >= 0.88 * (last - first + 1), number
        assert residuals.std() < 0.2, number


def test_an_edge_of_the_background_makes_a_point_less_certain(shared_data: Path) -> None:
    folder = shared_data / "stripe-on-board"
    sigmas = []
    for number, (first, last) in {3: (90, 320), 5: (90, 300)}.items():
        picture = read(folder / f"{number}_right.jpg")
        stripe = STRIPE_DETECTORS.make("zero-crossing").detect(LaserView(picture, None, "green"))
        inside = (stripe.line >= first) & (stripe.line <= last)
        sigmas.append(np.median(np.sqrt(stripe.variance[inside])))
    assert sigmas[0] > 1.8 * sigmas[1]


def test_a_saturated_white_core_gives_one_stripe_and_not_its_two_flanks(shared_data: Path) -> None:
    folder = shared_data / "turntable-green" / "frames"
    for name in ("table_071.jpg", "table_137.jpg", "table_217.jpg"):
        view = LaserView(read(folder / name), None, "green")
        stripe = STRIPE_DETECTORS.make("zero-crossing").detect(view)
        # The wall behind the table is even: the stripe is a straight line on it, up to its plaster.
        residuals = off_a_line(stripe, 5, 150)
        assert len(residuals) >= 135
        assert residuals.std() < 0.45


def test_the_stripe_on_the_white_margin_is_straight(shared_data: Path) -> None:
    picture = read(shared_data / "turntable-green" / "frames" / "laser_062.jpg")
    stripe = STRIPE_DETECTORS.make("zero-crossing").detect(LaserView(picture, None, "green"))
    residuals = off_a_line(stripe, 10, 215)
    assert len(residuals) >= 195
    assert residuals.std() < 0.15


def test_a_red_stripe_in_a_video_is_followed_without_a_partner(shared_data: Path) -> None:
    video = cv2.VideoCapture(str(shared_data / "video" / "bottle_cap.mp4"))
    pictures: list[Image] = []
    while len(pictures) < 60:
        is_read, picture = video.read()
        if is_read:
            pictures.append(np.asarray(picture, np.uint8))
    for picture in pictures[20::20]:
        stripe = STRIPE_DETECTORS.make("zero-crossing").detect(LaserView(picture, None, "red"))
        assert len(stripe) > 150
        lit = picture[stripe.line, np.rint(stripe.pixels[:, 0]).astype(np.intp), 2]
        assert np.mean(lit > 60) > 0.8
