import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rig_strategies import angles, directions, motions

from app.geometry.arrays import Floats
from app.geometry.transform import (
    RigidTransform,
    rotation_about,
    rotation_from_rvec,
    rvec_from_rotation,
    skew,
)

POINTS = np.random.default_rng(3).normal(0.0, 100.0, (7, 3))


@given(motions(), motions(), motions())
def test_motions_associate(a: RigidTransform, b: RigidTransform, c: RigidTransform) -> None:
    assert_allclose(((a @ b) @ c) @ POINTS, (a @ (b @ c)) @ POINTS, atol=1e-8)


@given(motions(), motions())
def test_a_product_moves_as_its_factors_in_turn(a: RigidTransform, b: RigidTransform) -> None:
    assert_allclose((a @ b) @ POINTS, a @ (b @ POINTS), atol=1e-8)


@given(motions())
def test_the_inverse_undoes_on_both_sides(a: RigidTransform) -> None:
    assert_allclose((a.inverse() @ a) @ POINTS, POINTS, atol=1e-9)
    assert_allclose((a @ a.inverse()) @ POINTS, POINTS, atol=1e-9)


@given(motions())
def test_the_identity_changes_nothing(a: RigidTransform) -> None:
    one = RigidTransform.identity()
    assert_allclose((one @ a) @ POINTS, a @ POINTS)
    assert_allclose((a @ one) @ POINTS, a @ POINTS)


@given(motions())
def test_a_motion_keeps_distances_and_handedness(a: RigidTransform) -> None:
    moved = a @ POINTS
    assert_allclose(
        np.linalg.norm(moved[1:] - moved[:-1], axis=1), np.linalg.norm(POINTS[1:] - POINTS[:-1], axis=1)
    )
    assert_allclose(np.linalg.det(a.rotation), 1.0)


@given(directions(), st.floats(0.0, np.pi))
def test_a_rotation_vector_survives_the_matrix(direction: Floats, angle: float) -> None:
    rotation = rotation_from_rvec(direction * angle)
    assert_allclose(rotation_from_rvec(rvec_from_rotation(rotation)), rotation, atol=2e-8)


@given(directions(), st.one_of(st.just(0.0), st.floats(1e-12, 1e-3)))
def test_near_half_a_turn_the_rotation_vector_keeps_its_axis(direction: Floats, short: float) -> None:
    rotation = rotation_about(direction, np.pi - short)
    found = rvec_from_rotation(rotation)
    assert_allclose(np.linalg.norm(found), np.pi - short, atol=1e-6)
    assert_allclose(abs(found @ direction), np.pi - short, atol=1e-5)
    if short > 1e-5:
        assert_allclose(found, direction * (np.pi - short), atol=1e-5)


@given(directions(), st.floats(1e-15, 1e-5))
def test_a_tiny_rotation_vector_survives_the_matrix(direction: Floats, angle: float) -> None:
    assert_allclose(rvec_from_rotation(rotation_from_rvec(direction * angle)), direction * angle, atol=1e-15)


@given(directions(), angles, angles)
def test_turns_about_one_axis_add_up(direction: Floats, first: float, second: float) -> None:
    both = rotation_about(direction, first) @ rotation_about(direction, second)
    assert_allclose(both, rotation_about(direction, first + second), atol=1e-12)


@given(directions(), directions())
def test_the_skew_matrix_is_the_cross_product(v: Floats, w: Floats) -> None:
    assert_allclose(skew(v) @ w, np.cross(v, w), atol=1e-15)
