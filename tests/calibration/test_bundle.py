"""The bundle's derivatives against central differences, and what its increments mean."""

from dataclasses import replace

import numpy as np
import pytest

from app.calibration.bundle import Columns, Corners, State, Stripes, basis_across, moved, residuals
from app.calibration.platter import UNIT_CORNERS
from app.geometry.arrays import Floats
from app.geometry.transform import rotation_from_rvec

BODIES, ANGLES, LASERS, MARKERS, SEEN = 4, 5, 2, 3, 30
DISTORTION = range(4, 9)


def some_state(seed: int) -> State:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3) - np.array([0.0, 3.0, 0.0])
    planes = rng.normal(size=(LASERS, 4))
    planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1)[:, None]
    planes[:, 3] = 150.0
    return State(
        camera=np.array([1400.0, 1390.0, 640.0, 360.0, -0.1, 0.05, 0.001, -0.002, 0.01]),
        size=(1280, 720),
        axis_point=np.array([5.0, 30.0, 300.0]),
        axis_direction=direction / np.linalg.norm(direction),
        planes=planes,
        rotations=np.array([rotation_from_rvec(rng.normal(size=3) * 0.3) for _ in range(BODIES)]),
        translations=rng.normal(size=(BODIES, 3)) * 10.0 + [0.0, 0.0, 300.0],
        angles=rng.normal(size=ANGLES),
        layout=rng.normal(size=(MARKERS, 3)) * [20.0, 20.0, 1.0],
        marker_mm=30.0,
    )


def some_corners(seed: int) -> Corners:
    """Boards and markers, in free views and turned ones."""
    rng = np.random.default_rng(seed)
    marker = rng.integers(-1, MARKERS, SEEN)
    on_board = np.column_stack([rng.uniform(-40.0, 40.0, (SEEN, 2)), np.zeros(SEEN)])
    on_body = np.where(marker[:, None] >= 0, UNIT_CORNERS[rng.integers(0, 4, SEEN)], on_board)
    return Corners(
        pixels=rng.uniform(0.0, 700.0, (SEEN, 2)),
        body=rng.integers(0, BODIES, SEEN),
        angle=rng.integers(-1, ANGLES, SEEN),
        on_body=on_body,
        marker=marker,
        sigma=rng.uniform(0.05, 0.4, SEEN),
        group=np.zeros(SEEN, np.intp),
    )


def some_stripes(seed: int) -> Stripes:
    rng = np.random.default_rng(seed)
    return Stripes(
        pixels=rng.uniform(200.0, 700.0, (SEEN, 2)),
        body=rng.integers(0, BODIES, SEEN),
        angle=rng.integers(-1, ANGLES, SEEN),
        laser=rng.integers(0, LASERS, SEEN),
        across=rng.integers(0, 2, SEEN),
        sigma=rng.uniform(0.05, 0.4, SEEN),
        group=np.zeros(SEEN, np.intp),
    )


NOTHING = np.zeros(0, np.intp)
NO_CORNERS = Corners(np.zeros((0, 2)), NOTHING, NOTHING, np.zeros((0, 3)), NOTHING, np.zeros(0), NOTHING)
NO_STRIPES = Stripes(np.zeros((0, 2)), NOTHING, NOTHING, NOTHING, NOTHING, np.zeros(0), NOTHING)


def by_differences(state: State, corners: Corners, stripes: Stripes) -> Floats:
    columns = []
    for k in range(Columns.of(state).total):
        step = np.zeros(Columns.of(state).total)
        step[k] = 1e-7 if k in DISTORTION else 1e-6
        ahead, _ = residuals(moved(state, step), corners, stripes)
        behind, _ = residuals(moved(state, -step), corners, stripes)
        columns.append((ahead - behind) / (2.0 * step[k]))
    return np.column_stack(columns)


def with_stripes_on_planes(state: State, stripes: Stripes) -> tuple[State, Stripes]:
    """A plane for every stripe point that holds it: a stripe's scale is not differentiated, so the
    derivative is exact only where the residual is zero."""
    planes = state.planes[stripes.laser].copy()
    own = replace(stripes, laser=np.arange(len(stripes.pixels)))
    first, second = (
        residuals(replace(state, planes=planes + np.array([0.0, 0.0, 0.0, shift])), NO_CORNERS, own)[0]
        for shift in (0.0, 1.0)
    )
    planes[:, 3] += first / (first - second)
    return replace(state, planes=planes), own


@pytest.mark.parametrize("seed", range(3))
def test_corners_move_with_every_unknown_as_differences_say(seed: int) -> None:
    state, corners = some_state(seed), some_corners(seed)
    _, jacobian = residuals(state, corners, NO_STRIPES)
    expected = by_differences(state, corners, NO_STRIPES)
    scale = np.maximum(np.abs(expected).max(axis=0), 1.0)
    assert np.abs((jacobian.toarray() - expected) / scale).max() < 1e-4
    used = np.abs(expected).max(axis=0) > 0.0
    assert used[: Columns.of(state).planes].all()
    assert used[Columns.of(state).bodies :].all()


@pytest.mark.parametrize("seed", range(3))
def test_stripes_move_with_every_unknown_as_differences_say(seed: int) -> None:
    state, stripes = with_stripes_on_planes(some_state(seed), some_stripes(seed))
    at_rest, jacobian = residuals(state, NO_CORNERS, stripes)
    assert np.abs(at_rest).max() < 1e-6
    expected = by_differences(state, NO_CORNERS, stripes)
    scale = np.maximum(np.abs(expected).max(axis=0), 1.0)
    assert np.abs((jacobian.toarray() - expected) / scale).max() < 1e-4
    assert (np.abs(expected[:, : Columns.of(state).layout]).max(axis=0) > 0.0).all()


def test_a_free_view_knows_nothing_of_the_axis_or_of_angles() -> None:
    state, at = some_state(0), Columns.of(some_state(0))
    corners = replace(some_corners(0), angle=np.full(SEEN, -1))
    stripes = replace(some_stripes(0), angle=np.full(SEEN, -1))
    _, jacobian = residuals(state, corners, stripes)
    dense = np.abs(jacobian.toarray())
    assert dense[:, Columns.AXIS_POINT : Columns.AXIS_POINT + 4].max() == 0.0
    assert dense[:, at.angles : at.layout].max() == 0.0


def test_a_stripe_point_is_off_by_its_distance_across_in_units_of_its_sigma() -> None:
    state, stripes = with_stripes_on_planes(some_state(1), some_stripes(1))
    shift_px = 0.001
    shifted = stripes.pixels + shift_px * np.eye(2)[stripes.across]
    seen, _ = residuals(state, NO_CORNERS, replace(stripes, pixels=shifted))
    np.testing.assert_allclose(seen * stripes.sigma, shift_px, rtol=1e-3)


def test_steps_keep_directions_and_normals_of_length_one() -> None:
    state = some_state(2)
    delta = np.random.default_rng(0).normal(size=Columns.of(state).total) * 0.1
    after = moved(state, delta)
    assert np.linalg.norm(after.axis_direction) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(after.planes[:, :3], axis=1), 1.0, atol=1e-12)
    turned = after.rotations @ after.rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-12)


def test_no_step_changes_nothing() -> None:
    state = some_state(3)
    after = moved(state, np.zeros(Columns.of(state).total))
    for name in ("camera", "axis_point", "axis_direction", "planes", "rotations", "translations", "layout"):
        np.testing.assert_allclose(getattr(after, name), getattr(state, name), atol=1e-13)
    assert after.marker_mm == state.marker_mm


def test_the_basis_across_a_direction_is_orthonormal() -> None:
    for seed in range(5):
        direction = some_state(seed).axis_direction
        across = basis_across(direction)
        np.testing.assert_allclose(across.T @ across, np.eye(2), atol=1e-12)
        np.testing.assert_allclose(direction @ across, 0.0, atol=1e-12)
