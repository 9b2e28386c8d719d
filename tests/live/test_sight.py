"""What live pictures show is what a scan would see."""

import time
from dataclasses import replace

import numpy as np
import pytest
from counted_camera import SIZE, stripe_picture

from app.devices.camera_driver import RawFrame
from app.devices.frame import Frame, LazyPicture, Mounting
from app.live.dark import DarkReference
from app.live.develop import Flavour, develop
from app.live.known import Known
from app.live.search import Found
from app.live.settings import Kind, LiveSettings
from app.live.sight import Sight
from app.recording.picture import decode
from app.scanning.region import Region
from app.scanning.sources import scan_detector
from app.simulation.rig import standard_rig
from app.vision.stripe import Image, LaserView
from app.vision.threshold import laser_mask, laser_response

_RED = Known({"left": "red"})


def test_the_stripe_is_the_one_that_a_scan_finds() -> None:
    image = stripe_picture(5)
    (seen,) = sight(image, lit=("left",)).stripes
    expected = scan_detector().detect(LaserView(image, None, "red"))
    assert seen.laser == "left"
    assert len(seen.stripe) > 200
    assert np.array_equal(seen.stripe.pixels, expected.pixels)


def test_the_mask_is_the_papers_thresholded_picture() -> None:
    image = stripe_picture(5)
    mask = sight(image, LiveSettings(threshold=60.0), lit=("left",)).mask
    assert np.array_equal(mask, laser_mask(laser_response(LaserView(image, None, "red")), 60.0))
    assert mask.any()
    assert mask.sum() < sight(image, LiveSettings(threshold=20.0), lit=("left",)).mask.sum()


def test_with_all_lasers_off_there_is_no_stripe_but_a_mask_of_what_disturbs() -> None:
    seen = sight(stripe_picture(5), lit=())
    assert seen.stripes == ()
    assert seen.mask.any()


def test_words_are_written_only_for_viewers_that_cannot_say_them_beside_the_picture() -> None:
    seen = sight(stripe_picture(5), lit=())
    assert seen.captions == ("no laser on",)
    flavours = (Flavour(Kind.OVERLAY), Flavour(Kind.OVERLAY, is_captioned=False))
    told, bare = (decode(develop(each, seen, Found(), None).data, SIZE)[:20, :80] for each in flavours)
    assert told.max() > 230
    assert bare.max() < 200


def test_a_bench_without_named_lasers_is_looked_at_all_the_same() -> None:
    (seen,) = sight(stripe_picture(5), known=Known()).stripes
    assert seen.laser == ""
    assert len(seen.stripe) > 200


def test_a_laser_that_is_asked_for_is_looked_for_even_where_the_bench_has_it_off() -> None:
    (seen,) = sight(stripe_picture(5), LiveSettings(laser="left"), lit=()).stripes
    assert len(seen.stripe) > 200


def test_the_channel_can_be_chosen() -> None:
    green = stripe_picture(5)[:, :, [0, 2, 1]]
    assert len(sight(green, LiveSettings(channel="green"), lit=("left",)).stripes[0].stripe) > 200
    assert len(sight(green, LiveSettings(channel="blue"), lit=("left",)).stripes[0].stripe) == 0


def test_every_other_line_gives_the_same_stripe_with_half_the_points() -> None:
    image = stripe_picture(5)
    (all_lines,) = sight(image, lit=("left",)).stripes
    (half,) = sight(image, LiveSettings(line_step=2), lit=("left",)).stripes
    assert set(half.stripe.line) <= set(range(0, SIZE[1], 2))
    assert len(half.stripe) == pytest.approx(len(all_lines.stripe) / 2, abs=2)
    assert np.array_equal(half.stripe.pixels[:, 1], half.stripe.line)
    assert np.median(half.stripe.pixels[:, 0]) == pytest.approx(
        np.median(all_lines.stripe.pixels[:, 0]), abs=0.1
    )


def test_numbers_tell_of_points_clipping_brightness_and_focus() -> None:
    good = sight(stripe_picture(5), lit=("left",)).numbers
    glaring = sight(stripe_picture(5, level=900.0), lit=("left",)).numbers
    assert good.points > 200
    assert good.saturated == 0
    assert glaring.saturated > 200
    assert sum(good.histogram) == pytest.approx(1.0)
    assert good.histogram[30 // 4] > 0.8
    sharp = np.random.default_rng(0).integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
    soft = np.full_like(sharp, 128)
    assert sight(sharp).numbers.focus > 100.0 * (1.0 + sight(soft).numbers.focus)


def test_two_stripes_are_named_by_where_the_calibration_has_them() -> None:
    rig = standard_rig(*SIZE).rig
    colours = {"right": "red", "left": "red"}
    known = Known(colours, rig)  # type: ignore[arg-type]
    assert known.in_order(("right", "left")) == ("left", "right")
    assert Known(colours).in_order(("right", "left")) == ("", "")  # type: ignore[arg-type]
    both = np.maximum(stripe_picture(0), stripe_picture(0)[:, ::-1])
    seen = sight(both, lit=("left", "right"), known=known).stripes
    assert [each.laser for each in seen] == ["left", "right"]
    assert np.median(seen[0].stripe.pixels[:, 0]) < SIZE[0] / 2 < np.median(seen[1].stripe.pixels[:, 0])
    (only,) = sight(both, LiveSettings(laser="right"), lit=("left", "right"), known=known).stripes
    assert np.array_equal(only.stripe.pixels, seen[1].stripe.pixels)


def test_the_limits_of_the_scan_are_drawn_where_the_calibration_fits_the_picture() -> None:
    rig = standard_rig(*SIZE).rig
    known = Known({}, rig, Region(60.0, 0.0, 80.0))
    outlines = known.outlines(SIZE)
    assert len(outlines) == 4
    inside = np.vstack(outlines)
    assert np.isfinite(inside).all()
    assert known.outlines((640, 480)) == ()
    assert Known({}).outlines(SIZE) == ()
    assert Known({}, rig, Region()).outlines(SIZE) == ()


def test_a_difference_takes_away_what_the_last_dark_picture_shows_too() -> None:
    red_edge = stripe_picture(14)
    red_edge[:, 200:204, 2] = 220
    without = stripe_picture(14, level=0.0)
    without[:, 200:204, 2] = 220
    dark = DarkReference()
    now_s = time.monotonic()
    for k in range(5):
        dark.note(
            replace(frame_of(without), exposed_s=now_s + 0.1 * k, arrived_s=now_s + 0.1 * k), is_lit=False
        )
    lit = frame_of(red_edge)
    plain = Sight(lit, LiveSettings(), _RED, ("left",), dark)
    difference = Sight(lit, LiveSettings(channel="difference"), _RED, ("left",), dark)
    assert plain.mask[:, 199:205].any()
    assert not difference.mask[:, 199:205].any()
    assert difference.mask[:, 60:90].any()


def test_a_picture_is_no_dark_one_until_the_laser_has_been_off_for_a_while() -> None:
    dark, now_s = DarkReference(), time.monotonic()
    lit, first, later = (
        replace(frame_of(stripe_picture(k)), exposed_s=now_s + at_s, arrived_s=now_s + at_s)
        for k, at_s in enumerate((0.0, 0.1, 0.5))
    )
    dark.note(lit, is_lit=True)
    dark.note(first, is_lit=False)
    assert dark.partner(lit) is None
    dark.note(later, is_lit=False)
    assert dark.partner(lit) is later
    assert dark.partner(later) is None
    assert dark.partner(replace(lit, exposure_us=5.0)) is None


def frame_of(image: Image) -> Frame:
    size = (image.shape[1], image.shape[0])
    now_s = time.monotonic()
    return Frame(0, size, now_s, now_s, 1000.0, True, LazyPicture(RawFrame(image), size, Mounting(), "test"))


def sight(
    image: Image, settings: LiveSettings | None = None, *, lit: tuple[str, ...] = (), known: Known = _RED
) -> Sight:
    return Sight(frame_of(image), settings or LiveSettings(), known, lit, DarkReference())
