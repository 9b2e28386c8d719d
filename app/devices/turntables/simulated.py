"""The board of the simulated world, spoken to by its true driver through a true port."""

from app.devices.turntable import TURNTABLES, Turntable
from app.errors import OptionError
from app.simulation.firmware.kernel import FIRMWARES
from app.simulation.world import SimulatedWorld


def open_simulated(world: SimulatedWorld) -> Turntable:
    """The driver for the dialect that the world's board speaks.

    Args:
        world: whose board it is.

    Raises:
        OptionError: no driver speaks the dialect.
    """
    dialect = world.plan.dialect
    firmware = FIRMWARES.maker(dialect)
    # A dialect may be a variety of a board, such as `horus_clone`, and say so.
    driver = str(getattr(firmware, "driver", "")) or dialect
    if driver not in set(TURNTABLES) - {"simulated"}:
        raise OptionError(
            f"There is no driver for a simulated board that speaks {dialect!r}.",
            f"Choose a dialect from: {', '.join(sorted(set(FIRMWARES) & set(TURNTABLES)))}.",
        )
    options: dict[str, object] = dict(getattr(firmware, "driver_options", {}))
    return TURNTABLES.make(driver, **{**options, "port": str(world.port.link)})


TURNTABLES.register("simulated", open_simulated)
