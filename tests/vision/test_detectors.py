"""What every registered stripe detector must do, whatever its way."""

import numpy as np
import pytest
from stripe_pictures import LINES, WIDTH, colour_picture, grey_picture, slanted_centre, stripe_light

from app.errors import OptionError
from app.geometry.arrays import Floats
from app.vision.stripe import STRIPE_DETECTORS, LaserColour, LaserStripe, LaserView, StripeDetector

CHANNELS: dict[LaserColour, int] = {"blue": 0, "green": 1, "red": 2}


@pytest.fixture(params=list(STRIPE_DETECTORS))
def detector(request: pytest.FixtureRequest) -> StripeDetector:
    return STRIPE_DETECTORS.make(request.param)


def errors_of(stripe: LaserStripe, centre: Floats) -> Floats:
    assert len(stripe) >= 0.95 * len(centre)
    errors: Floats = stripe.pixels[:, 0] - centre[stripe.line]
    return errors


@pytest.mark.parametrize("colour", ["red", "green", "blue", "any"])
@pytest.mark.parametrize("has_partner", [True, False])
def test_a_stripe_of_any_colour_is_found(
    detector: StripeDetector, colour: LaserColour, has_partner: bool
) -> None:
    centre = slanted_centre()
    lit = colour_picture(stripe_light(centre), CHANNELS.get(colour, 2))
    dark = colour_picture(np.zeros((LINES, WIDTH)), 0) if has_partner else None
    errors = errors_of(detector.detect(LaserView(lit, dark, colour)), centre)
    assert np.abs(errors).max() < 0.6
    assert abs(errors.mean()) < 0.05


@pytest.mark.parametrize("has_partner", [True, False])
def test_a_stripe_in_grey_pictures_is_found(detector: StripeDetector, has_partner: bool) -> None:
    centre = slanted_centre()
    dark = grey_picture(np.zeros((LINES, WIDTH))) if has_partner else None
    errors = errors_of(detector.detect(LaserView(grey_picture(stripe_light(centre)), dark, "red")), centre)
    assert np.abs(errors).max() < 0.6


def test_a_horizontal_stripe_is_the_vertical_one_transposed(detector: StripeDetector) -> None:
    lit = colour_picture(stripe_light(slanted_centre()), 2)
    dark = colour_picture(np.zeros((LINES, WIDTH)), 2)
    upright = detector.detect(LaserView(lit, dark, "red"))
    lying = detector.detect(LaserView(lit.swapaxes(0, 1), dark.swapaxes(0, 1), "red", "horizontal"))
    np.testing.assert_allclose(lying.pixels, upright.pixels[:, ::-1])
    np.testing.assert_array_equal(lying.line, upright.line)


def test_pictures_need_not_be_contiguous(detector: StripeDetector) -> None:
    lit = colour_picture(stripe_light(slanted_centre()), 1)
    dark = colour_picture(np.zeros((LINES, WIDTH)), 1)
    straight = detector.detect(LaserView(lit, dark, "green"))
    strided = detector.detect(LaserView(np.repeat(lit, 2, axis=0)[::2], np.asfortranarray(dark), "green"))
    np.testing.assert_array_equal(strided.pixels, straight.pixels)


def test_partners_of_different_size_are_refused(detector: StripeDetector) -> None:
    lit = colour_picture(stripe_light(slanted_centre()), 1)
    with pytest.raises(ValueError, match="differ in shape"):
        detector.detect(LaserView(lit, lit[:-1], "green"))
    with pytest.raises(ValueError, match="differ in shape"):
        detector.detect(LaserView(lit, lit[:, :, 0], "green"))


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("size", [(40, 60), (1, 1), (3, 700), (50, 2)])
def test_an_even_picture_holds_no_stripe(detector: StripeDetector, level: int, size: tuple[int, int]) -> None:
    even = np.full((*size, 3), level, np.uint8)
    for dark in (None, even, np.zeros_like(even)):
        stripe = detector.detect(LaserView(even, dark, "red"))
        if level == 0 or (dark is not None and dark.any()):
            assert len(stripe) == 0
        assert_sound(stripe)


@pytest.mark.parametrize("has_partner", [True, False])
def test_noise_alone_gives_few_points(detector: StripeDetector, has_partner: bool) -> None:
    rng = np.random.default_rng(5)
    lit, dark = (np.clip(rng.normal(60.0, 4.0, (300, 400, 3)), 0, 255).astype(np.uint8) for _ in range(2))
    stripe = detector.detect(LaserView(lit, dark if has_partner else None, "green"))
    assert len(stripe) < 15
    assert_sound(stripe)


def test_a_random_picture_does_no_harm(detector: StripeDetector) -> None:
    rng = np.random.default_rng(6)
    for shape in [(64, 64, 3), (64, 64), (7, 300, 3)]:
        lit, dark = (rng.integers(0, 256, shape, np.uint8) for _ in range(2))
        for partner in (dark, None):
            for orientation in ("vertical", "horizontal"):
                assert_sound(detector.detect(LaserView(lit, partner, "any", orientation)))


def test_a_line_without_light_is_left_out(detector: StripeDetector) -> None:
    light = stripe_light(slanted_centre())
    light[40:55] = 0.0
    dark = colour_picture(np.zeros_like(light), 2)
    stripe = detector.detect(LaserView(colour_picture(light, 2), dark, "red"))
    assert not np.isin(stripe.line, np.arange(40, 55)).any()
    assert len(np.unique(stripe.segment)) == 2


def test_two_stripes_come_out_in_their_order(detector: StripeDetector) -> None:
    left, right = slanted_centre() - 40.0, slanted_centre() + 30.0
    # The left one is the brighter in the upper half, the right one below.
    factor = np.where(np.arange(LINES) < 60, 1.0, 0.6)[:, None]
    light = stripe_light(left) * factor + stripe_light(right) * (1.6 - factor)
    light[20:30] -= stripe_light(left[20:30])
    view = LaserView(
        colour_picture(np.maximum(light, 0.0), 2), colour_picture(np.zeros_like(light), 2), "red"
    )
    first, second = detector.detect_several(view, 2)
    assert np.abs(first.pixels[:, 0] - left[first.line]).max() < 0.6
    assert np.abs(second.pixels[:, 0] - right[second.line]).max() < 0.6
    assert len(second) == LINES
    assert len(first) == LINES - 10


def test_the_next_peak_of_a_line_is_told(detector: StripeDetector) -> None:
    light = stripe_light(slanted_centre()) + stripe_light(slanted_centre() - 45.0, height=80.0)
    stripe = detector.detect(LaserView(colour_picture(light, 2), colour_picture(light * 0.0, 2), "red"))
    np.testing.assert_allclose(stripe.second, 0.5, atol=0.05)


def test_an_unknown_name_is_told_with_the_known_ones() -> None:
    with pytest.raises(OptionError, match="stripe detector") as caught:
        STRIPE_DETECTORS.make("telepathy")
    assert "centroid, threshold, zero-crossing" in caught.value.hint


def assert_sound(stripe: LaserStripe) -> None:
    for values in (stripe.pixels, stripe.strength, stripe.variance, stripe.width, stripe.second):
        assert np.isfinite(values).all()
    assert (stripe.variance > 0.0).all()
    assert ((stripe.second >= 0.0) & (stripe.second <= 1.0)).all()
    assert (np.diff(stripe.line) > 0).all()
