"""The file that describes a bench: camera, board, and which laser is which. TOML, for people to write."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from app.devices.camera_driver import ControlName
from app.documents import Entry, Json, compose
from app.errors import BenchFileError
from app.files import reason, write_whole
from app.recording.manifest_facts import BoardFacts, Direction, LaserFacts, Name, PlatterFacts
from app.simulation.firmware.kernel import FIRMWARES

SIMULATED = "simulated"
_MOST_BYTES = 1_000_000
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]


class DriverEntry(Entry):
    """A device: its driver, and in further keys the driver's own options."""

    driver: Name

    @property
    def options(self) -> Json:
        """What the driver is built with."""
        return self.unknown


class TurntableEntry(DriverEntry):
    """The controller board.

    Attributes:
        direction: which way the table turns as angles grow, seen from above.
        settle_s: how long the table trembles after a move.
    """

    direction: Direction = "ccw"
    settle_s: Seconds = 0.1


class LaserEntry(LaserFacts):
    """A laser, by the number of the board's output."""

    channel: Annotated[int, Field(ge=0, le=1000)]


class ControlsEntry(Entry):
    """Values of the camera's controls for one kind of picture; `"auto"` leaves one to the camera."""

    @model_validator(mode="after")
    def _are_known(self) -> "ControlsEntry":
        for name, value in self.unknown.items():
            if name not in list(ControlName):
                raise ValueError(f"has no control {name!r}; known are {', '.join(ControlName)}")
            if value != "auto" and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise ValueError(f'{name} must be a number or "auto"')
        return self

    @property
    def values(self) -> dict[ControlName, float | None]:
        """The values; None for the camera's own automatic."""
        return {
            ControlName(name): None if value == "auto" else float(value)
            for name, value in self.unknown.items()
        }


class CameraEntry(DriverEntry):
    """The camera.

    Attributes:
        rotation: degrees clockwise by which its pictures are turned.
        mirror: whether they are mirrored, left to right, after that.
        latency_ms: from exposure to arrival, as the doctor measured it; for cameras that do not tell.
        laser, texture, board: control values for pictures of each kind.
    """

    rotation: Literal[0, 90, 180, 270] = 0
    mirror: bool = False
    latency_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 0.0
    laser: ControlsEntry = ControlsEntry()
    texture: ControlsEntry = ControlsEntry()
    board: ControlsEntry = ControlsEntry()


class BenchDescription(Entry):
    """A whole bench file."""

    name: Name = "bench"
    turntable: TurntableEntry
    camera: CameraEntry
    lasers: Annotated[tuple[LaserEntry, ...], Field(max_length=64)] = ()
    platter: PlatterFacts | None = None
    board: BoardFacts | None = None
    simulation: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _makes_sense(self) -> "BenchDescription":
        if self.unknown:
            raise ValueError(f"has a table or key that means nothing: {next(iter(self.unknown))!r}")
        for what in ("name", "channel"):
            values = [getattr(laser, what) for laser in self.lasers]
            for value in values:
                if values.count(value) > 1:
                    raise ValueError(f"has two lasers with the {what} {value!r}")
        return self

    @property
    def is_simulated(self) -> bool:
        """Whether a device of it is."""
        return SIMULATED in (self.turntable.driver, self.camera.driver)


@dataclass(frozen=True, slots=True)
class LaserChoice:
    """A laser for a new bench file."""

    name: str
    channel: int
    colour: str = "red"


def read_bench_file(path: Path | str) -> BenchDescription:
    """The description in a TOML file.

    Raises:
        BenchFileError: naming the file and the entry.
    """
    try:
        with Path(path).open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise BenchFileError(str(path), reason(error)) from error
    if len(data) > _MOST_BYTES:
        raise BenchFileError(str(path), "is larger than a bench file can be")
    return parse_bench(data, str(path))


def parse_bench(data: bytes, where: str) -> BenchDescription:
    """The bytes of a bench file; `where` names it in messages. Raises as `read_bench_file`."""
    try:
        document = tomllib.loads(data.decode("utf-8-sig"))
        json.dumps(document)
    except UnicodeDecodeError as error:
        raise BenchFileError(where, f"is not UTF-8 text (byte {error.start})") from error
    except tomllib.TOMLDecodeError as error:
        raise BenchFileError(where, f"is not TOML ({error})") from error
    except (TypeError, RecursionError) as error:
        raise BenchFileError(where, "holds a value that no entry takes, such as a date") from error
    return compose(BenchDescription, document, where, BenchFileError)


def simulated_description(dialect: str = "horus", **simulation: Any) -> BenchDescription:
    """The bench that needs no hardware.

    Args:
        dialect: which firmware the simulated board speaks.
        simulation: further keys of the `[simulation]` table, see `WorldPlan`.
    """
    channels: tuple[int, ...] = getattr(FIRMWARES.maker(dialect), "channels", ())
    document: Json = {
        "name": "simulated bench",
        "turntable": {"driver": SIMULATED, "settle_s": 0.0},
        "camera": {"driver": SIMULATED},
        "lasers": [
            {"name": name, "channel": channel, "colour": "red"}
            for name, channel in zip(("left", "right"), channels, strict=False)
        ],
        "simulation": {"dialect": dialect, **simulation},
    }
    return compose(BenchDescription, document, "the simulated bench", BenchFileError)


def draft_bench(
    turntable: Mapping[str, Any], camera: Mapping[str, Any], lasers: Sequence[LaserChoice] = ()
) -> str:
    """The text of a new bench file, with a comment where a person should look.

    Args:
        turntable: `driver` and its options, such as `port`.
        camera: likewise.
        lasers: what is known of them; two at the outputs 1 and 2 where nothing is.
    """
    import tomlkit  # only needed to write one

    document = tomlkit.document()
    document.add(
        tomlkit.comment("A bench of Turnscan: `turnscan doctor --bench FILE` measures what is said here.")
    )
    document.add("name", tomlkit.item("bench"))
    table = tomlkit.table()
    for key, value in turntable.items():
        table.add(key, value)
    table.add(tomlkit.comment("Which way the table turns as angles grow, seen from above: ccw or cw."))
    table.add("direction", "ccw")
    document.add("turntable", table)
    view = tomlkit.table()
    for key, value in camera.items():
        view.add(key, value)
    view.add(
        tomlkit.comment("Degrees clockwise by which pictures are turned, and whether they are mirrored.")
    )
    view.add("rotation", 0)
    view.add("mirror", False)
    document.add("camera", view)
    listed = tomlkit.aot()
    for laser in lasers or (LaserChoice("left", 1), LaserChoice("right", 2)):
        entry = tomlkit.table()
        entry.add("name", laser.name)
        entry.add("channel", laser.channel)
        entry.add("colour", laser.colour)
        listed.append(entry)
    document.add("lasers", listed)
    return tomlkit.dumps(document)


def write_bench_file(path: Path, text: str) -> None:
    """Put a new bench file at a path, after making sure that it can be read back.

    Raises:
        BenchFileError: the text is no bench file.
        OutputError: it cannot be written.
    """
    parse_bench(text.encode(), str(path))
    write_whole(path, text.encode())
