"""What a preset does to clouds of a scan, by what they were made of."""

import json
from pathlib import Path

import numpy as np

from app.geometry.cloud import PointCloud
from app.jobs.finishing import finishing_of
from app.library.library import Library
from app.surface.finish import Preset
from app.surface.ply import write_ply


def test_what_was_joined_gets_no_base_and_neither_does_what_was_cleaned_of_it(tmp_path: Path) -> None:
    library = Library(tmp_path)
    for scan, clouds in (("both", {"1": "joined", "2": "cleaned"}), ("one", {"1": "", "2": "cleaned"})):
        (tmp_path / scan / "clouds").mkdir(parents=True)
        for name, made_by in clouds.items():
            path = tmp_path / scan / "clouds" / f"{name}.ply"
            write_ply(path, _point())
            path.with_suffix(".json").write_text(json.dumps({"made_by": made_by}))
        for name in clouds:
            found = finishing_of(library.scan(scan), f"clouds/{name}.ply")[Preset.PRINT]
            assert found.mesh.has_flat_base is (scan == "one")


def _point() -> PointCloud:
    one = np.ones(1, np.float32)
    return PointCloud(
        np.zeros((1, 3), np.float32), np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8), one,
        np.zeros(1, np.uint8), one, one,
    )  # fmt: skip
