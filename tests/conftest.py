"""What every test may ask for."""

from pathlib import Path

import steady_time  # noqa: F401 (before whatever keeps time)

# isort: split
import pytest
from hypothesis import settings

from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan, Views
from app.simulation.rig import standard_rig

# A busy machine is no failure.
settings.register_profile("house", deadline=None)
settings.load_profile("house")

# Files that take long: begun last they would keep one core busy while the other has nothing to do. A file is
# never torn apart, so that what its tests share is made once.
_FIRST = (
    "test_batch.py",
    "test_journey.py",
    "test_planted_faults.py",
    "test_turntable_green.py",
    "test_whole_scan.py",
    "test_jobs.py",
    "test_stopping.py",
    "test_journeys.py",
    "test_page.py",
    "test_every_board.py",
    "test_in_browser.py",
    "test_identify.py",
)

# Boards, cameras, servers and browsers that keep a pace of their own, which a busy machine cannot promise:
# what fails there is tried again, and the summary tells how often.
_IN_REAL_TIME = {"api", "checkup", "cli", "devices", "jobs", "live", "scanning", "serving", "viewer", "web"}

_SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; what needs its pace is tried again."""
    items.sort(key=lambda item: item.path.name not in _FIRST)
    for item in items:
        if item.path.parent.name in _IN_REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=2))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real pictures beside the checkout; a test that needs it is skipped where it is missing."""
    if not _SHARED_DATA.is_dir():
        pytest.skip(f"real pictures not found at {_SHARED_DATA}")
    return _SHARED_DATA


@pytest.fixture(scope="session")
def small_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration with every role and a scan of a ball in twelve stops, 640 x 480; not to be written to."""
    folder = tmp_path_factory.mktemp("recordings") / "small"
    views = Views(intrinsics=8, laser_plane=4, placements=2, angles_deg=(-24.0, 0.0, 24.0), axis_line=1)
    plan = SimulationPlan(scanner=standard_rig(640, 480), views=views, steps=12, texture_every=4)
    simulate_recording(folder, plan)
    return folder
