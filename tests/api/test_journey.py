"""The whole way from an empty folder to a measured ball, with nothing but calls of the API."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from running_server import Running, running_server

from app.client import ScannerProblem, Turnscan
from benchmarks.journeys import Journey, by_client, scanned_by_client

_STEPS = {"ball": {"steps": 12}}
_TURN = {"mode": "continuous", "seconds_per_turn": 8.0, "lasers": ["left"], "with_dark": False}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("journey")


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Running]:
    with running_server(folder, object="sphere", width=480, height=360, rate=8.0, fps=5.0) as server:
        yield server


@pytest.fixture(scope="module")
def journey(server: Running, folder: Path) -> Journey:
    """An automatic calibration and a scan in steps; the benchmark goes there without the client, too."""
    world = server.services.bench.world
    assert world is not None
    return by_client(_address(server), folder, world.stage, _STEPS)


def test_a_ball_is_calibrated_for_scanned_and_true(journey: Journey, server: Running, folder: Path) -> None:
    assert journey.true_mm < 0.1
    assert journey.scans["ball"].points > 2000
    assert journey.scans["ball"].off_mm < 0.1
    with Turnscan(_address(server)) as scanner:
        name = scanner.upload(next(folder.glob("*.ply")), "Sent there")
        assert scanner.export(name, folder / "ball.xyz", "xyz").stat().st_size > 10_000
        with pytest.raises(ScannerProblem, match="There is no scan called 'nothing'") as refused:
            scanner.download("nothing", folder / "nothing.ply")
    assert (refused.value.kind, refused.value.status) == ("turnscan:scan-not-found", 404)
    assert not [*folder.glob("*nothing*")]


@pytest.mark.usefixtures("journey")
def test_a_continuous_scan_of_the_client_is_true(server: Running, tmp_path: Path) -> None:
    # A table that turns steadily is timed, so this one's time is ours.
    shutil.copytree(server.services.calibrations.folder, tmp_path / "calibration_store")
    with running_server(tmp_path, object="sphere", width=480, height=360, rate=1.0, fps=15.0) as steady:
        world = steady.services.bench.world
        assert world is not None
        with Turnscan(_address(steady)) as scanner:
            ball = scanned_by_client(scanner, tmp_path, world.stage, "turned", _TURN)
    assert ball.points > 2000
    assert ball.off_mm < 0.1


def _address(server: Running) -> str:
    return f"http://localhost:{server.port}"
