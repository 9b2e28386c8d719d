"""What the commands that use a bench share: finding its file and its calibration."""

from pathlib import Path

from app.calibration.record import CalibrationRecord
from app.calibration.store import STORE, CalibrationStore
from app.cli.console import warn
from app.devices.bench import Bench
from app.devices.bench_file import SIMULATED, BenchDescription, read_bench_file, simulated_description
from app.errors import BenchFileError, CalibrationFileError

BENCH_FILE = Path("bench.toml")


def bench_description(spec: str) -> BenchDescription:
    """What `--bench` names: a file, `simulated`, or `simulated:` with the dialect of its board.

    Raises:
        BenchFileError: the file cannot be used, or none was named and there is no bench.toml.
    """
    name, _, dialect = spec.partition(":")
    if name == SIMULATED:
        return simulated_description(**({"dialect": dialect} if dialect else {}))
    if not spec and not BENCH_FILE.is_file():
        raise BenchFileError(
            "--bench",
            f"is not given, and there is no {BENCH_FILE} here",
            "Write one with `turnscan devices --write bench.toml`, or try `--bench simulated`.",
        )
    return read_bench_file(Path(spec) if spec else BENCH_FILE)


def calibration_for(bench: Bench, file: Path | None) -> CalibrationRecord | None:
    """The calibration of a bench: as named, else the simulated world's own, else the one in use.

    Raises:
        CalibrationFileError: the named file cannot be used.
    """
    if file is not None:
        return CalibrationRecord.load(file)
    if bench.world is not None:
        rig = bench.world.rig
        return CalibrationRecord(
            camera=rig.camera,
            lasers=rig.lasers,
            axis=rig.axis,
            method="simulated",
            source="the simulated bench",
        )
    store = CalibrationStore(STORE)
    try:
        return store.current()
    except CalibrationFileError as error:
        if store.paths():
            warn([f"The calibration in use cannot be read, and none is used. {error.message}. {error.hint}"])
        return None
