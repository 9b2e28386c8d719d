"""The layout of the markers in a calibration file, and what a hostile one may hold."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.calibration.platter_file import layout_of, platter_entry
from app.calibration.record import CalibrationRecord
from app.errors import CalibrationFileError
from benchmarks.synthetic_views import typical_rig

SQUARE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


def record_with(platter: Any) -> CalibrationRecord:
    return CalibrationRecord(camera=typical_rig().camera, extra={"platter": platter}, source="rig.json")


def test_a_layout_survives_the_file_to_the_last_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    layout = {number: rng.normal(size=(4, 3)) for number in (3, 17, 42)}
    record_with(platter_entry(layout, 19.6)).save(tmp_path / "rig.json")
    read = layout_of(CalibrationRecord.load(tmp_path / "rig.json"))
    assert list(read) == [3, 17, 42]
    for number, corners in layout.items():
        np.testing.assert_array_equal(read[number], corners)


def test_a_calibration_without_markers_has_no_layout() -> None:
    assert layout_of(CalibrationRecord(camera=typical_rig().camera)) == {}


@pytest.mark.parametrize(
    "platter",
    [
        [],
        "markers",
        7,
        {},
        {"corners_mm": []},
        {"corners_mm": None},
        {"corners_mm": {"five": SQUARE}},
        {"corners_mm": {"5": SQUARE[:3]}},
        {"corners_mm": {"5": [*SQUARE, [0.0, 0.0, 0.0]]}},
        {"corners_mm": {"5": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]}},
        {"corners_mm": {"5": [["a", "b", "c"]] * 4}},
        {"corners_mm": {"5": [[1.0, 2.0, float("nan")]] * 4}},
        {"corners_mm": {"5": [[1.0, 2.0, 1e400]] * 4}},
        {"corners_mm": {"5": [[1.0, 2.0, [3.0]], *SQUARE[1:]]}},
        {"corners_mm": {"5": None}},
        {"corners_mm": {"5": [[10**400, 0, 0]] * 4}},
        {"corners_mm": {"5": {"x": 1.0}}},
        {"corners_mm": {str(number): SQUARE for number in range(10_001)}},
    ],
)
def test_what_is_no_layout_is_refused_by_name(platter: Any) -> None:
    with pytest.raises(CalibrationFileError, match=r"rig\.json: platter"):
        layout_of(record_with(platter))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=4),
    max_leaves=20,
)


@given(platter=JSON | st.fixed_dictionaries({"corners_mm": st.dictionaries(st.sampled_from("012x"), JSON)}))
def test_any_entry_is_a_layout_or_refused(platter: Any) -> None:
    try:
        layout = layout_of(record_with(platter))
    except CalibrationFileError:
        return
    assert all(corners.shape == (4, 3) and np.isfinite(corners).all() for corners in layout.values())
    json.dumps({str(number): corners.tolist() for number, corners in layout.items()}, allow_nan=False)
