"""Benches that people have, as first drafts; and drafts made into bench files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import tomlkit

from app.devices.bench_file import LaserChoice, draft_bench

# Outputs as each driver numbers them; 1 and 2 where nothing is said.
LASERS: Mapping[str, Sequence[LaserChoice]] = {
    "fabscan": (LaserChoice("left", 1), LaserChoice("right", 0)),
    "fabscan100": (LaserChoice("left", 1),),
    "marlin": (LaserChoice("left", 11), LaserChoice("right", 6)),
    "sardauscan": (LaserChoice("left", 0), LaserChoice("right", 1)),
}


@dataclass(frozen=True, slots=True)
class Preset:
    """A kind of scanner.

    Attributes:
        name: for programs.
        title: for people.
        board: driver of its board.
        camera: driver of its camera.
        note: what its owner should know; empty for nothing.
    """

    name: str
    title: str
    board: str
    camera: str = "uvc"
    note: str = ""


PRESETS = (
    Preset("ciclop", "Ciclop with the Horus firmware", "horus"),
    Preset("fabscan", "FabScanPi", "fabscan"),
    Preset("fabscan100", "FabScan100, the first one", "fabscan100", note="It has one laser."),
    Preset(
        "atlas", "ATLAS 3D (FreeLSS)", "manual", "picamera",
        "Its motor and lasers hang on pins of the Raspberry Pi, for which there is no driver: turn the table "
        "by hand, or give it a board with Grbl.",
    ),
    Preset("sardauscan", "Sardauscan", "sardauscan"),
    Preset("grbl", "A board with plain Grbl", "grbl"),
    Preset("marlin", "A board with Marlin", "marlin", note="Check the pins of the lasers."),
    Preset("manual", "A table that is turned by hand", "manual"),
    Preset("simulated", "The simulated scanner", "simulated", "simulated"),
)  # fmt: skip


def bench_text(
    name: str,
    turntable: Mapping[str, Any],
    camera: Mapping[str, Any],
    lasers: Sequence[LaserChoice] = (),
    *,
    direction: str = "ccw",
    rotation: int = 0,
    is_mirrored: bool = False,
) -> str:
    """The text of a bench file.

    Args:
        name: of the bench.
        turntable: `driver` and its options, such as `port`.
        camera: likewise.
        lasers: those that boards of this driver usually have where none is given.
        direction: which way the table turns as angles grow, seen from above.
        rotation: degrees clockwise by which pictures are turned.
        is_mirrored: whether they are mirrored after that.
    """
    text = draft_bench(turntable, camera, lasers or LASERS.get(str(turntable["driver"]), ()))
    document: Any = tomlkit.parse(text)
    document["name"] = name
    document["turntable"]["direction"] = direction
    document["camera"]["rotation"], document["camera"]["mirror"] = rotation, is_mirrored
    return tomlkit.dumps(document)
