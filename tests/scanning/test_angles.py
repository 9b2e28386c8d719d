"""What the markers say against what the motor was told."""

from collections.abc import Callable

import numpy as np
import pytest

from app.geometry.arrays import Floats
from app.geometry.platter import SeenMarkers
from app.geometry.rig import Rig
from app.scanning.angles import AngleReader, AngleSummary
from app.scanning.region import default_region
from app.simulation.rig import standard_rig

RIG = standard_rig(480, 270).rig
SQUARE = np.array([[-8.0, 8.0, 0.0], [8.0, 8.0, 0.0], [8.0, -8.0, 0.0], [-8.0, -8.0, 0.0]])
LAYOUT = {1: SQUARE + np.array([45.0, 0.0, 0.0]), 2: SQUARE - np.array([45.0, 0.0, 0.0])}
TOLD = np.radians(np.arange(0.0, 360.0, 6.0))


def seen_at(angle: float, rig: Rig = RIG) -> SeenMarkers:
    in_camera = rig.axis.table_from_camera(angle).inverse()
    return {number: rig.camera.project(in_camera @ corners) for number, corners in LAYOUT.items()}


def read(
    true: Floats, direction: float = 1.0, is_shown: Callable[[int], bool] = lambda _: True
) -> tuple[Floats, AngleSummary]:
    reader = AngleReader(RIG, LAYOUT, direction=direction)
    told = direction * TOLD
    angles = [
        reader.read(t, seen_at(a) if is_shown(k) else {})
        for k, (t, a) in enumerate(zip(told, true, strict=True))
    ]
    return np.array(angles), reader.summary()


def test_markers_win_over_the_motor() -> None:
    true = TOLD + np.radians(0.4 * np.sin(3.0 * TOLD))
    angles, summary = read(true)
    np.testing.assert_allclose(angles, true, atol=1e-6)
    assert summary.source == "markers"
    assert summary.stops_with_markers == len(TOLD)
    assert summary.largest_deg == pytest.approx(0.4, abs=0.01)
    assert summary.rms_deg == pytest.approx(0.4 / np.sqrt(2.0), abs=0.01)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_lost_steps_leave_the_table_behind_whichever_way_it_turns(direction: float) -> None:
    late = np.where(np.arange(len(TOLD)) >= 50, 1.8, 0.0)
    _, summary = read(direction * (TOLD - np.radians(late)), direction)
    assert summary.sentence == (
        "The table stood up to 1.8 degrees behind the commanded angle at 10 of 60 stops, the first being "
        "number 50 and the last 59; the motor lost steps: 1.80 before stop 50 (degrees)."
    )


def test_another_zero_of_the_table_is_no_disagreement() -> None:
    angles, summary = read(TOLD + 1.0)
    np.testing.assert_allclose(angles, TOLD + 1.0, atol=1e-6)
    assert summary.largest_deg < 1e-4
    assert summary.sentence == ""


def test_a_stop_without_markers_is_off_as_much_as_the_one_before() -> None:
    true = TOLD + np.radians(np.where(np.arange(len(TOLD)) >= 20, -2.0, 0.0))
    angles, summary = read(true, is_shown=lambda k: k % 10 != 5)
    np.testing.assert_allclose(angles, true, atol=1e-6)
    assert summary.stops_with_markers == 54


def test_markers_that_fit_nowhere_are_not_believed() -> None:
    reader = AngleReader(RIG, LAYOUT)
    wrong = {number: corners * np.array([1.0, 0.3]) for number, corners in seen_at(0.0).items()}
    assert reader.read(0.5, wrong) == 0.5
    assert reader.summary().stops_with_markers == 0


def test_markers_tell_how_large_the_table_is() -> None:
    assert default_region(RIG, LAYOUT).radius_mm == pytest.approx(1.25 * np.hypot(53.0, 8.0))
    assert default_region(RIG).radius_mm > 100.0
    assert default_region(RIG).lowest_mm == -5.0
