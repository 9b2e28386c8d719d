"""The small pure parts of a reconstruction."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from app.errors import ReconstructionError
from app.recording.shot import Role, Shot
from app.scanning.agreement import agreement
from app.scanning.angles import AngleReader
from app.scanning.background import Background
from app.scanning.exposures import combine_exposures
from app.scanning.facing import LaserSides, stripe_orientation
from app.scanning.normals import normals_of
from app.scanning.profile import Slice, without_scraps
from app.scanning.sample import Sample
from app.scanning.stops import group_stops, stops_of_shots
from app.scanning.table import check_by_points
from app.simulation.rig import standard_rig
from app.vision.stripe import LaserStripe, LaserView

BLACK = np.zeros((4, 4, 3), np.uint8)


def shot(
    angle_deg: float | None, *lasers: str, role: Role = Role.SCAN, exposure_us: float | None = None
) -> Shot:
    return Shot(BLACK, role, lasers, angle_deg, exposure_us=exposure_us, name=f"{angle_deg} {lasers}")


def stripe(lines: list[int], across: list[float], saturated: list[bool] | None = None) -> LaserStripe:
    n = len(lines)
    ones = np.ones(n)
    return LaserStripe(
        np.column_stack([across, lines]).astype(float), np.array(lines, np.intp), 50.0 * ones, 0.01 * ones,
        2.0 * ones, 0.0 * ones, np.zeros(n, np.intp),
        np.array(saturated if saturated is not None else [False] * n, np.bool_),
    )  # fmt: skip


def turn_of(frame: Shot) -> float:
    return float(np.radians(frame.angle_deg or 0.0))


def test_frames_of_one_angle_make_one_stop() -> None:
    frames = [
        shot(0.0, "left"), shot(0.0, "right"), shot(0.0, role=Role.TEXTURE),
        shot(9.0, "left"), shot(9.0, "right"),
    ]  # fmt: skip
    first, second = group_stops(frames, turn_of, [frames[2]])
    assert [view.lasers for view in first.views] == [("left",), ("right",)]
    assert first.views[0].exposures[0].dark is frames[2]
    assert second.views[0].exposures[0].dark is None
    assert second.texture is not None
    assert not second.texture.is_here


def test_a_scan_that_went_round_once_for_each_laser_is_put_together() -> None:
    frames = [shot(a, laser) for laser in ("left", "right") for a in (0.0, 90.0, 180.0)]
    stops = group_stops(frames, turn_of)
    assert [len(stop.views) for stop in stops] == [2, 2, 2]


def test_frames_that_differ_in_exposure_alone_are_a_stack() -> None:
    frames = [shot(0.0, "left", exposure_us=e) for e in (100.0, 400.0, 200.0)]
    frames += [shot(0.0, role=Role.TEXTURE, exposure_us=200.0)]
    (stop,) = group_stops(frames, turn_of)
    (view,) = stop.views
    assert [pair.lit.exposure_us for pair in view.exposures] == [400.0, 200.0, 100.0]
    assert [pair.dark is not None for pair in view.exposures] == [False, True, False]


def test_frames_that_are_the_same_twice_are_two_views() -> None:
    (stop,) = group_stops([shot(0.0, "left"), shot(0.0, "left")], turn_of)
    assert [len(view.exposures) for view in stop.views] == [1, 1]


def test_shots_of_a_steady_turn_do_not_wait_for_the_next() -> None:
    taken = 0

    def shots() -> Iterator[Shot]:
        nonlocal taken
        for angle_deg in (0.0, 1.0):
            taken += 1
            yield shot(angle_deg, "left")

    for number, stop in enumerate(stops_of_shots(shots(), np.radians, each_alone=True)):
        assert stop.number == number == taken - 1


def test_a_shot_without_an_angle_is_an_error() -> None:
    with pytest.raises(ReconstructionError, match="no table angle"):
        list(stops_of_shots([shot(0.0, "left"), shot(None, "left")], np.radians))


def test_a_stack_takes_the_longest_exposure_that_is_not_clipped() -> None:
    long = stripe([1, 2, 3, 4], [10.0, 10.1, 10.2, 10.3], [False, True, True, False])
    short = stripe([2, 3, 5], [20.1, 20.2, 20.3], [False, True, False])
    both = combine_exposures([long, short], "vertical")
    assert_array_equal(both.line, [1, 2, 3, 4, 5])
    assert_array_equal(both.pixels[:, 0], [10.0, 20.1, 20.2, 10.3, 20.3])
    assert_array_equal(both.segment, [0, 1, 1, 2, 3])


def test_background_pixels_are_left_out_line_by_line() -> None:
    empty_scene = Background.of(
        [("left", stripe([3, 4, 5], [10.0, 11.0, 12.0])), ("left", stripe([3], [40.0]))],
        {"left": "vertical"},
        10,
    )
    seen = stripe([2, 3, 4, 5], [10.0, 10.5, 20.0, 13.0])
    assert_array_equal(empty_scene.without("left", seen, "vertical").line, [2, 4])
    assert len(empty_scene.without("right", seen, "vertical")) == 4
    assert len(empty_scene.without("left", stripe([3], [40.4]), "vertical")) == 0


def test_scraps_of_stripe_are_left_out() -> None:
    pieces = stripe(list(range(9)), [5.0] * 9)
    pieces.segment[:] = [0, 0, 0, 0, 1, 1, 2, 3, 3]
    assert_array_equal(without_scraps(pieces, 3).line, [0, 1, 2, 3])
    assert len(without_scraps(LaserStripe.empty(), 3)) == 0


def test_each_laser_has_its_own_side_of_the_picture() -> None:
    rig = standard_rig(320, 180).rig
    sides = LaserSides.of(rig, ("left", "right"))
    assert not (sides.mask["left"] & sides.mask["right"]).any()
    for laser in ("left", "right"):
        assert sides.mask[laser].mean() > 0.3
        v, u = np.nonzero(sides.mask[laser])
        points = rig.triangulate(np.column_stack([u, v]).astype(float), laser, 0.0)
        assert (points[:, 0] > 0.0).all()


@pytest.mark.parametrize("has_dark", [True, False])
@pytest.mark.parametrize("orientation", ["vertical", "horizontal"])
def test_the_other_side_looks_unlit(has_dark: bool, orientation: str) -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[:, :15] = True
    lit = np.full((20, 30), 30, np.uint8)
    lit[:, 5] = lit[:, 22] = 200
    dark = np.full((20, 30), 30, np.uint8) if has_dark else None
    sides = LaserSides({"left": mask})
    seen = sides.view_of("left", LaserView(lit, dark, "any", orientation))  # type: ignore[arg-type]
    assert seen.lit.shape == lit.shape
    assert (seen.lit[:, 5] == 200).all()
    if orientation == "vertical" or has_dark:
        assert (seen.lit[:, 22] == 30).all()


def test_the_stripe_runs_as_the_laser_stands() -> None:
    assert stripe_orientation(standard_rig().rig, "left") == "vertical"


@given(st.lists(st.integers(0, 400), max_size=30))
def test_a_sample_is_an_even_choice(sizes: list[int]) -> None:
    sample, start = Sample(1, 100), 0
    for size in sizes:
        sample.add(np.arange(start, start + size, dtype=np.float32)[:, None])
        start += size
    kept = sample.rows[:, 0]
    assert len(kept) <= 100
    assert len(kept) >= min(start, 40)
    assert (np.diff(kept) > 0).all()
    if len(kept) > 3:
        assert np.diff(kept).max() == np.diff(kept).min()


def table(tilt_deg: float, height_mm: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    radius, turn = 100.0 * np.sqrt(rng.uniform(0.02, 1.0, 20_000)), rng.uniform(0.0, 2.0 * np.pi, 20_000)
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    z = height_mm + np.tan(np.radians(tilt_deg)) * x + rng.normal(0.0, 0.1, 20_000)
    return np.column_stack([x, y, z]).astype(np.float32)


@pytest.mark.parametrize(("tilt_deg", "height_mm"), [(0.0, 0.0), (0.0, 3.0), (2.0, -1.5), (5.0, 0.0)])
def test_a_table_is_found_beside_the_object_on_it(tilt_deg: float, height_mm: float) -> None:
    points = table(tilt_deg, height_mm)
    rng = np.random.default_rng(1)
    is_object = np.hypot(points[:, 0], points[:, 1]) < 45.0
    points[is_object, 2] += rng.uniform(0.0, 60.0, np.count_nonzero(is_object)).astype(np.float32)
    found = check_by_points(points)
    assert found is not None
    assert found.offset_mm == pytest.approx(height_mm, abs=0.15)
    assert found.tilt_deg == pytest.approx(tilt_deg, abs=0.15)
    assert found.is_moved == (tilt_deg > 0.5 or abs(height_mm) > 1.0)
    assert bool(found.sentence) == found.is_moved


def test_a_ball_alone_is_no_table() -> None:
    rng = np.random.default_rng(0)
    out = rng.normal(0.0, 1.0, (20_000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    ball = (30.0 * out + [5.0, 0.0, 30.0]).astype(np.float32)
    assert check_by_points(ball) is None
    assert check_by_points(np.zeros((0, 3), np.float32)) is None


def ball_with_normals(shift: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = rng.normal(0.0, 1.0, (15_000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    points = (30.0 + rng.normal(0.0, 0.02, 15_000))[:, None] * out + shift
    return np.hstack([points, out]).astype(np.float32)


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, -0.05, 0.2]])
def test_the_disagreement_of_two_lasers_is_measured(shift: list[float]) -> None:
    moved = np.array(shift)
    pair = agreement(("a", "b"), ball_with_normals(np.zeros(3), 1), ball_with_normals(moved, 2))
    assert pair is not None
    assert_allclose(pair.shift_mm, -moved, atol=0.006)
    assert pair.disagreement_mm == pytest.approx(float(np.linalg.norm(moved)), abs=0.006)


def test_clouds_that_do_not_meet_say_nothing() -> None:
    far = ball_with_normals(np.array([200.0, 0.0, 0.0]), 1)
    assert agreement(("a", "b"), ball_with_normals(np.zeros(3), 1), far) is None
    assert agreement(("a", "b"), np.zeros((0, 6), np.float32), far) is None


def test_angles_without_markers_are_the_nominal_ones() -> None:
    reader = AngleReader(standard_rig().rig, {}, "constant speed")
    assert [reader.read(turn, {}) for turn in (0.0, 1.0)] == [0.0, 1.0]
    assert reader.summary().source == "constant speed"
    assert reader.summary().sentence == ""


def wall_slice(angle_rad: float, slope: float) -> Slice:
    """A stripe on the plane x = slope * y, y growing with the angle."""
    lines = list(range(40))
    y = np.full(40, 60.0 * angle_rad)
    points = np.column_stack([slope * y, y, 0.3 * np.arange(40)]).astype(np.float32)
    scalars, camera = np.ones(40, np.float32), np.array([300.0, 0.0, 50.0], np.float32)
    seen = stripe(lines, [100.0] * 40)
    return Slice(0, "left", angle_rad, seen, points, scalars, np.zeros((40, 3), np.uint8), camera)


@given(st.floats(-1.5, 1.5))
def test_normals_of_a_wall_stand_on_it_and_look_at_the_camera(slope: float) -> None:
    before, here, after = (wall_slice(0.01 * k, slope) for k in range(3))
    expected = np.array([1.0, -slope, 0.0]) / np.hypot(1.0, slope)
    for neighbours in ((before, after), (None, after), (before, None)):
        assert_allclose(normals_of(neighbours[0], here, neighbours[1]), np.tile(expected, (40, 1)), atol=2e-3)
    assert not normals_of(None, here, None).any()
