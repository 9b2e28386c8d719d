"""Every step: from JSON and back, and what holds of all of them."""

import numpy as np
import pytest
from clouds import some_cloud

from app.errors import OptionError
from app.geometry.cloud import PointCloud
from app.surface.step import STEPS, document_of, parse_step


@pytest.mark.parametrize("kind", list(STEPS))
def test_a_step_with_usual_settings_goes_to_json_and_back(kind: str) -> None:
    step = parse_step({"kind": kind})
    assert parse_step(document_of(step)) == step


@pytest.mark.parametrize("kind", list(STEPS))
def test_an_empty_cloud_stays_empty(kind: str) -> None:
    assert len(parse_step({"kind": kind}).apply(PointCloud.empty())) == 0


@pytest.mark.parametrize(
    ("document", "named"),
    [({"kind": "magic"}, "magic"), ({"kind": "quality", "least": 7}, "least"), ({}, "step")],
)
def test_a_wrong_step_is_refused_by_name(document: dict[str, object], named: str) -> None:
    with pytest.raises(OptionError, match=named):
        parse_step(document)


def test_badly_seen_points_go_and_unknown_uncertainty_stays() -> None:
    cloud = some_cloud(200, seed=1)
    cloud.sigma_mm[:50] = np.nan
    kept = parse_step({"kind": "quality", "least": 0.5, "most_sigma_mm": 1e-6}).apply(cloud)
    assert len(kept) == np.count_nonzero(cloud.quality[:50] >= 0.5)
