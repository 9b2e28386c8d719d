"""A program that is killed leaves a library as it was, or as it was to become: nothing in between."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

_HERE = Path(__file__).resolve().parent


@pytest.fixture(scope="module")
def deaths(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[list[str]]]:
    """For each change the state after each death; the last after a change that lived."""
    if not hasattr(os, "fork"):
        pytest.skip("this system cannot fork")
    done = subprocess.run(
        [sys.executable, str(_HERE / "dying.py"), str(tmp_path_factory.mktemp("dying"))],
        capture_output=True,
        cwd=_HERE.parents[1],
        env=os.environ | {"PYTHONPATH": str(_HERE.parents[1])},
    )
    assert done.returncode == 0, done.stderr.decode()
    result: dict[str, list[list[str]]] = json.loads(done.stdout)
    return result


_OLD = ["bin:cup|3", "mug|mug||3"]


@pytest.mark.parametrize(
    ("change", "new"),
    [
        ("rename", ["bin:cup|3", "mug|Another||3"]),
        ("note", ["bin:cup|3", "mug|mug|A note|3"]),
        ("delete", ["bin:cup|3", "bin:mug|3"]),
        ("restore", ["cup|cup||3", "mug|mug||3"]),
        ("empty", ["mug|mug||3"]),
        ("import-folder", ["bin:cup|3", "mug|mug||3", "pot|pot||3"]),
        ("import-zip", ["bin:cup|3", "jar|jar||3", "mug|mug||3"]),
    ],
)
def test_whenever_a_change_is_killed_the_old_or_the_new_is_there(
    change: str, new: list[str], deaths: dict[str, list[list[str]]]
) -> None:
    states = deaths[change]
    assert len(states) > 3
    assert states[0] == _OLD
    assert states[-1] == new
    switched = states.index(new)
    assert states == [_OLD] * switched + [new] * (len(states) - switched)
