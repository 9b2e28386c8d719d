"""The compiled kernels and their NumPy twin are one thing; numba may be missing, and its cache unwritable."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from stripe_pictures import colour_picture, slanted_centre, stripe_light

from app.vision.kernels import kernels, twin
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView
from benchmarks.stripe_scenes import SCENES, Scene

ROOT = Path(__file__).resolve().parents[2]


def assert_same(one: LaserStripe, other: LaserStripe) -> None:
    np.testing.assert_array_equal(one.line, other.line)
    np.testing.assert_allclose(one.pixels, other.pixels, atol=1e-6)
    np.testing.assert_allclose(one.variance, other.variance, rtol=1e-6)
    np.testing.assert_allclose(one.strength, other.strength, atol=1e-6)
    np.testing.assert_allclose(one.width, other.width, atol=1e-6)
    np.testing.assert_array_equal(one.segment, other.segment)
    np.testing.assert_array_equal(one.saturated, other.saturated)


def both(view: LaserView, count: int = 1, **options: object) -> None:
    pytest.importorskip("numba")
    fast = STRIPE_DETECTORS.make("zero-crossing", compiled=True, **options).detect_several(view, count)
    slow = STRIPE_DETECTORS.make("zero-crossing", compiled=False, **options).detect_several(view, count)
    for one, other in zip(fast, slow, strict=True):
        assert_same(one, other)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_compiled_kernels_and_their_twin_give_the_same_stripe(scene: Scene) -> None:
    lit, dark = scene.pair(1)
    both(LaserView(lit, dark, "red"))
    both(LaserView(lit[:, :, 0], dark[:, :, 0], "any"), scoring=True, smooth_rows=7)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_they_agree_on_several_stripes_without_a_partner(count: int) -> None:
    light = stripe_light(slanted_centre()) + stripe_light(slanted_centre() - 50.0, height=90.0)
    both(LaserView(colour_picture(light, 1, 40.0), None, "green"), count)


def test_they_agree_on_the_excess_of_every_colour() -> None:
    pytest.importorskip("numba")
    own, first = (np.ascontiguousarray(grey) for grey in np.mgrid[0:256, 0:256].astype(np.uint8))
    for second in (0, 1, 2, 3, 127, 128, 254, 255):
        planes = own, first, np.full_like(own, second)
        np.testing.assert_array_equal(kernels(True).colour_excess(*planes), twin.colour_excess(*planes))


def test_excess_is_half_of_what_a_channel_exceeds_the_mean_of_the_others_by() -> None:
    own, first, second = (np.array([[grey]], np.uint8) for grey in (200, 100, 60))
    assert twin.colour_excess(own, first, second).item() == 128 + (200 - 80) // 2


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    lines=st.integers(1, 40),
    width=st.integers(1, 200),
    has_partner=st.booleans(),
    smooth=st.booleans(),
)
def test_they_agree_on_whatever_they_are_shown(
    seed: int, lines: int, width: int, has_partner: bool, smooth: bool
) -> None:
    rng = np.random.default_rng(seed)
    lit, dark = (rng.integers(0, 256, (lines, width, 3)).astype(np.uint8) for _ in range(2))
    if smooth:
        wave = 127.0 + 127.0 * np.sin(np.linspace(0.0, rng.uniform(0.0, 60.0), width))
        lit = np.broadcast_to(wave[None, :, None], lit.shape).astype(np.uint8)
    both(LaserView(lit, dark if has_partner else None, "green"), 2)


def test_the_noise_terms_are_a_non_negative_least_squares_fit() -> None:
    rng = np.random.default_rng(0)
    for _ in range(40):
        level = np.sort(rng.uniform(0.0, 200.0, 12))
        means = np.column_stack([level**2, level, np.ones(12)])
        truth = rng.uniform(0.0, 1.0, 3) * [0.01, 0.3, 5.0] * (rng.random(3) > 0.3)
        squares = means @ truth * rng.uniform(0.5, 1.5, 12) + 0.3
        expected = squares
        for _ in range(2):
            wanted, _ = nnls(means / expected[:, None], squares / expected)
            expected = np.maximum(means @ wanted, 0.25)
        np.testing.assert_allclose(twin.noise_terms(means, squares, 0.25), wanted, rtol=1e-6, atol=1e-9)


def test_without_numba_the_twin_takes_over() -> None:
    # None in sys.modules is how Python itself marks a module that cannot be imported.
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "from app.vision.kernels import kernels, twin\n"
        "assert kernels() is twin\n"
        "try:\n    kernels(True)\nexcept ImportError:\n    print('refused')"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "refused"


def test_a_cache_that_cannot_be_written_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    numba = pytest.importorskip("numba")
    from app.vision.kernels import jit

    real = numba.njit

    def without_cache(**options: object) -> object:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    monkeypatch.setattr(numba, "njit", without_cache)
    assert jit.compiled(_double)(21) == 42


def _double(number: int) -> int:
    return 2 * number


def test_the_twin_is_there_by_name() -> None:
    assert kernels(False) is twin
