"""The length of a turn is found where there is one, and not where there is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.recording.padding import find_padding
from app.recording.period import find_turn


def turning(
    angles_rad: NDArray[np.floating], seed: int = 0, noise: float = 2.0, symmetry: float = 0.0
) -> NDArray[np.uint8]:
    """Thumbnails of something that turns: every pixel is a smooth periodic function of the angle.

    Args:
        angles_rad: (N,) of the pictures.
        seed: of the object.
        noise: sigma, grey levels.
        symmetry: 1 for an object that looks the same after half a turn.
    """
    rng = np.random.default_rng(seed)
    image = np.full((len(angles_rad), 12, 16), 100.0)
    for order in range(1, 9):
        share = (1.0 - symmetry if order % 2 else 1.0) * 40.0 / order
        a, b = rng.normal(0.0, share, (2, 1, 12, 16))
        phase = order * angles_rad[:, None, None]
        image += a * np.cos(phase) + b * np.sin(phase)
    return np.clip(image + rng.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)


@settings(max_examples=30, deadline=None)
@given(
    frames=st.floats(15.0, 180.0),
    turns=st.floats(1.4, 6.5),
    seed=st.integers(0, 1000),
    symmetry=st.floats(0.0, 0.7),
)
def test_the_turn_is_found_to_a_fraction_of_a_picture(
    frames: float, turns: float, seed: int, symmetry: float
) -> None:
    angles = 2.0 * np.pi / frames * np.arange(round(frames * turns))
    turn = find_turn(turning(angles, seed, symmetry=symmetry))
    assert turn.frames == pytest.approx(frames, abs=0.15)
    assert turn.contrast > 0.9
    assert turn.turns == pytest.approx(turns, abs=0.1)


def test_a_table_that_starts_late_and_stops_early_is_seen_through() -> None:
    angles = np.concatenate([np.zeros(40), 2.0 * np.pi / 80.0 * np.arange(240), np.full(30, 6.0 * np.pi)])
    turn = find_turn(turning(angles))
    assert turn.frames == pytest.approx(80.0, abs=0.2)
    assert abs(turn.first - 40) <= 5
    assert abs(turn.last - 279) <= 5


def test_a_long_clip_is_searched_coarsely_and_found_finely() -> None:
    angles = 2.0 * np.pi / 1111.3 * np.arange(4000)
    assert find_turn(turning(angles)).frames == pytest.approx(1111.3, abs=1.0)


@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_one_turn_or_less_does_not_tell_its_length(turns: float) -> None:
    assert not find_turn(turning(2.0 * np.pi / 200.0 * np.arange(200 * turns))).is_periodic


def test_noise_a_drift_a_walk_and_a_still_are_not_periodic() -> None:
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.normal(0.0, 4.0, (300, 12, 16)), axis=0)
    for clip in (
        rng.integers(0, 255, (300, 12, 16)),
        100.0 + rng.normal(0.0, 2.0, (300, 12, 16)),
        np.linspace(20.0, 200.0, 300)[:, None, None] + rng.normal(0.0, 2.0, (300, 12, 16)),
        (walk - walk.min()) / (walk.max() - walk.min()) * 255.0,
        np.full((300, 12, 16), 7),
        np.full((3, 12, 16), 7),
        np.zeros((0, 12, 16)),
    ):
        turn = find_turn(np.asarray(clip).astype(np.uint8))
        assert not turn.is_periodic


@settings(max_examples=40, deadline=None)
@given(stride=st.floats(2.0, 13.0), seed=st.integers(0, 100))
def test_repeated_frames_are_told_from_new_ones_and_from_key_frames(stride: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 600
    news = np.unique(np.round(np.arange(0.0, count, stride)).astype(int))
    changes = rng.exponential(0.01, count)
    changes[news[news < count]] = rng.uniform(0.3, 0.8, np.count_nonzero(news < count))
    if stride > 4.0:
        changes[100::250] = 0.4
    padding = find_padding(changes, np.arange(count))
    assert padding.stride == pytest.approx(stride, rel=0.01)
    assert len(padding.kept) == pytest.approx(count / stride, rel=0.02, abs=2)
    assert np.all(np.diff(padding.kept) > 0)
    assert np.abs(padding.kept - padding.ordinals * stride).max() <= 0.5 * stride + 1


@given(st.integers(0, 100))
def test_a_video_that_was_not_padded_is_left_alone(seed: int) -> None:
    changes = np.random.default_rng(seed).gamma(9.0, 0.1, 300)
    places = np.delete(np.arange(301), 77)
    padding = find_padding(changes, places)
    assert padding.stride == 1.0
    assert padding.ordinals.tolist() == places.tolist()
