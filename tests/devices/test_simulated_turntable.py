"""The simulated turntable is the dialect's true driver, and turns what the simulated camera sees."""

from pathlib import Path

import pytest

from app.devices.turntable import TURNTABLES
from app.errors import OptionError
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.world import SimulatedWorld, WorldPlan

# Every dialect that a driver speaks; each is tested in full with its driver.
SPOKEN = [name for name in FIRMWARES if (getattr(FIRMWARES.maker(name), "driver", "") or name) in TURNTABLES]
SMALL = {"width": 160, "height": 96, "rate": 10.0}


@pytest.mark.parametrize("dialect", SPOKEN)
def test_the_driver_turns_the_world_and_lights_its_lasers(dialect: str, tmp_path: Path) -> None:
    with SimulatedWorld(WorldPlan(dialect=dialect, **SMALL), tmp_path) as world:  # type: ignore[arg-type]
        table = TURNTABLES.make("simulated", world=world)
        table.connect()
        try:
            reached = table.move_to(12.0)
            turned = world.plant.at(world.clock.now_s()).angle_deg
            lit: list[str] = []
            for channel in getattr(FIRMWARES.maker(dialect), "channels", ())[:2]:
                table.set_laser(channel, True)
                lit += world.plant.lasers_on(world.clock.now_s())
                table.set_laser(channel, False)
        finally:
            table.disconnect()

        assert turned == pytest.approx(reached, abs=0.51 * table.facts.smallest_deg)
        assert reached == pytest.approx(12.0, abs=0.51 * table.facts.smallest_deg)
        assert lit == ["left", "right"][: len(table.facts.laser_channels)]


def test_a_dialect_without_a_driver_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dialect = next(iter(FIRMWARES))
    with SimulatedWorld(WorldPlan(dialect=dialect, **SMALL), tmp_path) as world:  # type: ignore[arg-type]
        monkeypatch.setattr(FIRMWARES.maker(dialect), "driver", "esperanto", raising=False)
        with pytest.raises(OptionError, match=dialect):
            TURNTABLES.make("simulated", world=world)
