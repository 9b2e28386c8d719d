"""Laser light in every pixel: what counts as laser, with a dark partner and without."""

import numpy as np
import pytest
from stripe_pictures import LINES, WIDTH, colour_picture, slanted_centre, stripe_light

from app.vision.stripe import LaserView
from app.vision.threshold import laser_channel, laser_mask, laser_response


def test_the_difference_to_the_dark_picture_is_the_response() -> None:
    light = stripe_light(slanted_centre())
    lit, dark = colour_picture(light, 2), colour_picture(light * 0.0, 2)
    response = laser_response(LaserView(lit, dark, "red"))
    np.testing.assert_allclose(response, np.rint(light), atol=1.0)


def test_a_darker_pixel_is_not_laser() -> None:
    lit, dark = np.full((4, 40, 3), 30, np.uint8), np.full((4, 40, 3), 90, np.uint8)
    assert not laser_response(LaserView(lit, dark, "green")).any()


def test_without_a_partner_a_bright_white_line_is_less_laser_than_a_dim_green_one() -> None:
    white = np.repeat(stripe_light(slanted_centre() - 60.0, height=150.0)[:, :, None], 3, axis=2)
    green = colour_picture(stripe_light(slanted_centre(), height=60.0), 1, 60.0)
    picture = np.clip(green + white, 0, 255).astype(np.uint8)
    response = laser_response(LaserView(picture, None, "green"))
    brightest = np.argmax(response, axis=1)
    assert np.abs(brightest - slanted_centre()).max() < 4.0


def test_a_core_that_has_lost_its_colour_stays_in_the_response() -> None:
    centre = slanted_centre()
    # So bright that all three channels are clipped in the core and only the flanks are green.
    picture = colour_picture(stripe_light(centre, height=4000.0, sigma_px=1.5), 1)
    response = laser_response(LaserView(picture, None, "green"))
    core = np.rint(centre).astype(np.intp)
    lines = np.arange(LINES)
    assert (picture[lines, core] == 255).all()
    assert (response[lines, core] >= 0.5 * response.max(axis=1)).all()


def test_any_laser_is_seen_by_the_channel_that_gains_most() -> None:
    dark = np.full((LINES, WIDTH, 3), 30, np.uint8)
    for channel in range(3):
        lit = colour_picture(stripe_light(slanted_centre()), channel, 30.0)
        assert laser_channel(lit, dark, "any") == channel
        assert laser_channel(lit, None, "any") == channel


def test_the_mask_holds_the_pixels_above_the_level() -> None:
    response = np.array([[0, 29, 30, 31, 255]], np.uint8)
    np.testing.assert_array_equal(laser_mask(response, 30.0), [[False, False, False, True, True]])


def test_a_horizontal_stripe_gives_the_response_transposed() -> None:
    lit = colour_picture(stripe_light(slanted_centre()), 0)
    upright = laser_response(LaserView(lit, None, "blue"))
    lying = laser_response(LaserView(lit.swapaxes(0, 1), None, "blue", "horizontal"))
    np.testing.assert_array_equal(lying, upright.T)


def test_partners_must_have_one_shape() -> None:
    with pytest.raises(ValueError, match="differ in shape"):
        laser_response(LaserView(np.zeros((4, 5, 3), np.uint8), np.zeros((4, 6, 3), np.uint8), "red"))
