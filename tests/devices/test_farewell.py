"""What the watchdog sends makes every board dark, whether or not opening its port resets it."""

import contextlib
import threading
from pathlib import Path

import pytest
from turntable_contract import wait_until

from app.devices.turntable import Farewell, Turntable
from app.devices.turntables.simulated import open_simulated
from app.devices.watchdog import farewell_facts
from app.devices.watchdog_process import play
from app.errors import DeviceError
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.world import SimulatedWorld, WorldPlan


@pytest.mark.parametrize("is_moving", [False, True])
@pytest.mark.parametrize("dialect", sorted(FIRMWARES))
def test_a_farewell_puts_the_lasers_out(dialect: str, is_moving: bool, tmp_path: Path) -> None:
    plan = WorldPlan(dialect, width=64, height=48, rate=10.0, resets_on_open=False)
    with SimulatedWorld(plan, tmp_path) as world:
        table = open_simulated(world)
        table.connect()
        try:
            for channel in table.facts.laser_channels:
                table.set_laser(channel, True)
            assert _lit(world)
            mover = threading.Thread(target=_turn, args=(table,), daemon=True)
            if is_moving:
                mover.start()
                wait_until(lambda: world.plant.at(world.clock.now_s()).is_moving)
            farewell = table.farewell
            assert isinstance(farewell, Farewell)
            # The program still has the port, and hangs: the watchdog opens it beside it.
            assert play(farewell_facts(farewell))
            wait_until(lambda: not _lit(world))
        finally:
            table.disconnect()
            if is_moving:
                mover.join(30.0)


def _lit(world: SimulatedWorld) -> frozenset[int]:
    return world.plant.at(world.clock.now_s()).outputs_on


def _turn(table: Turntable) -> None:
    with contextlib.suppress(DeviceError):
        table.move_to(60.0)
