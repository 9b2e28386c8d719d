"""What the default detector can do beyond the others."""

import numpy as np
import pytest
from stripe_pictures import LINES, WIDTH, grey_picture, slanted_centre, stripe_light

from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView

NOTHING = np.zeros((LINES, WIDTH))


def detected(view: LaserView, **options: object) -> LaserStripe:
    return STRIPE_DETECTORS.make("zero-crossing", **options).detect(view)


def test_dividing_by_the_dark_partner_takes_the_albedo_edge_out() -> None:
    rng = np.random.default_rng(2)
    centre = np.full(LINES, 90.3)
    # A surface twice as bright to the right of the middle of the stripe, blurred by the lens.
    albedo = 0.4 + 0.4 / (1.0 + np.exp(-(np.arange(WIDTH) - 91.0) / 0.6))
    noise = [rng.normal(0.0, 1.0, (LINES, WIDTH)) for _ in range(2)]
    lit = grey_picture(albedo * (stripe_light(centre, height=120.0) + 100.0) + noise[0], 0.0)
    dark = grey_picture(np.broadcast_to(albedo * 100.0, NOTHING.shape) + noise[1], 0.0)
    errors = [
        np.abs(np.median(detected(LaserView(lit, dark), evens_albedo=evens).pixels[:, 0]) - 90.3)
        for evens in (False, True)
    ]
    assert errors[0] > 0.4
    assert errors[1] < 0.1


def test_an_even_surface_is_not_divided() -> None:
    rng = np.random.default_rng(3)
    centre = slanted_centre()
    lit = grey_picture(stripe_light(centre, height=60.0) + rng.normal(0.0, 3.0, NOTHING.shape), 60.0)
    dark = grey_picture(rng.normal(0.0, 3.0, NOTHING.shape), 60.0)
    plain, evened = (detected(LaserView(lit, dark), evens_albedo=evens) for evens in (False, True))
    np.testing.assert_array_equal(plain.pixels, evened.pixels)


@pytest.mark.parametrize("scoring", [False, True, None])
@pytest.mark.parametrize("height", [400.0, 3000.0])
def test_a_clipped_core_is_found_in_its_middle(scoring: bool | None, height: float) -> None:
    centre = slanted_centre()
    lit = grey_picture(stripe_light(centre, height=height))
    for dark in (grey_picture(NOTHING), None):
        stripe = detected(LaserView(lit, dark), scoring=scoring)
        assert len(stripe) == LINES
        assert stripe.saturated.all()
        assert np.abs(stripe.pixels[:, 0] - centre).max() < 0.15


def test_a_peak_of_another_width_is_no_stripe() -> None:
    centre = slanted_centre()
    light = stripe_light(centre, sigma_px=1.5)
    light[50:60] = stripe_light(centre, sigma_px=12.0)[50:60]
    stripe = detected(LaserView(grey_picture(light), grey_picture(NOTHING)))
    assert not np.isin(stripe.line, np.arange(50, 60)).any()
    assert len(stripe) == LINES - 10


def test_a_line_with_a_strong_rival_can_be_left_out() -> None:
    centre = slanted_centre()
    light = stripe_light(centre)
    light[30:50] += stripe_light(centre - 50.0, height=140.0)[30:50]
    view = LaserView(grey_picture(light), grey_picture(NOTHING))
    assert len(detected(view)) == LINES
    assert len(detected(view, max_second=0.7)) == LINES - 20


@pytest.mark.parametrize("sigma_px", [0.8, 2.0, 5.0])
def test_the_width_of_the_stripe_is_told(sigma_px: float) -> None:
    lit = grey_picture(stripe_light(slanted_centre(), sigma_px=sigma_px))
    stripe = detected(LaserView(lit, grey_picture(NOTHING)))
    assert np.median(stripe.width) == pytest.approx(sigma_px, rel=0.05)
    assert np.median(stripe.strength) == pytest.approx(160.0, rel=0.05)


def test_a_stripe_at_the_border_is_left_out() -> None:
    centre = np.linspace(-8.0, 12.0, LINES)
    stripe = detected(LaserView(grey_picture(stripe_light(centre)), grey_picture(NOTHING)), sigma_px=2.0)
    assert stripe.line.min() >= np.flatnonzero(centre > 2.0)[0]
    assert np.abs(stripe.pixels[:, 0] - centre[stripe.line]).max() < 0.1


def test_given_noise_gives_the_variance_of_the_textbook() -> None:
    # White noise only: variance of the centre is 2 s v / (sqrt(pi) A^2) for the kernel that matches.
    stripe = detected(
        LaserView(grey_picture(stripe_light(slanted_centre())), grey_picture(NOTHING, 0.0)),
        sigma_px=2.0, filter_ratio=1.0, contrast=0.0, gain=1e9, read_noise=2.0, measures_noise=False,
        scoring=False,
    )  # fmt: skip
    wanted = 2.0 * 2.0 * 4.0 / (np.sqrt(np.pi) * stripe.strength**2)
    np.testing.assert_allclose(stripe.variance, wanted, rtol=0.01)
