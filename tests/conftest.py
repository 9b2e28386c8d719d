"""What every test may ask for."""

from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is no failure.
settings.register_profile("house", deadline=None)
settings.load_profile("house")

_SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real pictures beside the checkout; a test that needs it is skipped where it is missing."""
    if not _SHARED_DATA.is_dir():
        pytest.skip(f"real pictures not found at {_SHARED_DATA}")
    return _SHARED_DATA
