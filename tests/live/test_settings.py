"""Settings that people change while they look."""

from typing import Any

import pytest

from app.errors import OptionError
from app.live.settings import LiveSettings
from app.vision.stripe import STRIPE_DETECTORS

_LASERS = ("left", "right")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("detector", "crystal-ball"), ("detector", None), ("threshold", 0), ("threshold", 255.0),
        ("threshold", "high"), ("threshold", float("nan")), ("threshold", True), ("channel", "purple"),
        ("channel", 3), ("laser", "middle"), ("laser", 1), ("quality", 0), ("quality", 101),
        ("quality", 80.5), ("quality", True), ("width", 0), ("width", 1e3), ("line_step", 0),
        ("line_step", 9), ("shows_board", 1), ("shows_region", None), ("shows_markers", "yes"),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(OptionError) as caught:
        LiveSettings().changed(_LASERS, **{name: value})
    assert caught.value.message.startswith(f"{name}:")
    assert caught.value.hint


def test_an_unknown_setting_is_refused_with_those_that_exist() -> None:
    with pytest.raises(OptionError, match="no setting 'zoom'") as caught:
        LiveSettings().changed(_LASERS, zoom=2)
    assert "quality" in caught.value.hint


def test_of_several_changes_one_wrong_spoils_all() -> None:
    with pytest.raises(OptionError):
        LiveSettings().changed(_LASERS, quality=50, laser="middle")


def test_good_values_are_taken() -> None:
    changes: dict[str, Any] = {
        "detector": "centroid", "threshold": 33, "channel": "difference", "laser": "right", "quality": 60,
        "width": 480, "line_step": 2, "shows_board": False, "shows_markers": False, "shows_region": False,
    }  # fmt: skip
    new = LiveSettings().changed(_LASERS, **changes)
    assert {name: getattr(new, name) for name in changes} == changes
    assert (
        LiveSettings().changed(_LASERS, laser=None, channel=None, width=None, threshold=None)
        == LiveSettings()
    )


@pytest.mark.parametrize("name", list(STRIPE_DETECTORS))
def test_the_threshold_reaches_every_detector(name: str) -> None:
    own = LiveSettings().changed(_LASERS, detector=name)
    assert own.make_detector().min_strength == own.level  # type: ignore[attr-defined]
    raised = own.changed(_LASERS, threshold=77)
    assert raised.make_detector().min_strength == raised.level == 77  # type: ignore[attr-defined]
