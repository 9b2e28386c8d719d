"""What `recording.json` says: recording format, version 1."""

import json
from collections.abc import Mapping
from pathlib import PurePosixPath, PureWindowsPath
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from app.documents import Entry, Json, compose
from app.errors import RecordingError
from app.recording.manifest_facts import (
    LARGEST,
    BoardFacts,
    CameraFacts,
    LaserFacts,
    PlatterFacts,
    TurntableFacts,
    board_json,
    platter_json,
)
from app.recording.manifest_facts import Direction as Direction
from app.recording.shot import Role
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec
from app.vision.stripe import LaserColour

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
_BOARD_HINT = "Say in recording.json which calibration board the pictures show."
_PLATTER_HINT = "Say in recording.json which markers lie on the table."


class FrameEntry(Entry):
    """One frame of a recording: where it lies, and what the rig was doing."""

    file: str
    role: Role
    pose: Annotated[int, Field(ge=-LARGEST, le=LARGEST)] | None = None
    angle_deg: Number | None = None
    time_s: Number | None = None
    lasers_on: tuple[str, ...] = ()
    exposure_us: Annotated[float, Field(gt=0.0, le=LARGEST)] | None = None

    @field_validator("file")
    @classmethod
    def _stays_inside(cls, file: str) -> str:
        if not file or any(ord(letter) < 32 for letter in file) or len(file.encode()) > 1000:
            raise ValueError("is not a file name")
        # Judged as both systems would, so that a recording is as safe on one as on the other.
        for path in (PurePosixPath(file), PureWindowsPath(file)):
            if path.is_absolute() or path.anchor or ".." in path.parts:
                raise ValueError(f"{file!r} leaves the folder of the recording")
        return file

    @field_validator("lasers_on")
    @classmethod
    def _are_different(cls, lasers: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(lasers)) < len(lasers):
            raise ValueError("names a laser twice")
        return lasers


class Header(Entry):
    """Everything a recording says once."""

    format: Literal["turnscan-recording"]
    version: Literal[1]
    camera: CameraFacts
    lasers: Annotated[tuple[LaserFacts, ...], Field(max_length=64)] = ()
    turntable: TurntableFacts | None = None
    board: BoardFacts | None = None
    platter: PlatterFacts | None = None

    @field_validator("lasers")
    @classmethod
    def _have_different_names(cls, lasers: tuple[LaserFacts, ...]) -> tuple[LaserFacts, ...]:
        names = [laser.name for laser in lasers]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"has two lasers called {name!r}")
        return lasers

    @classmethod
    def of(
        cls,
        size: tuple[int, int],
        lasers: Mapping[str, LaserColour] | None = None,
        *,
        direction: Direction | None = "ccw",
        seconds_per_turn: float | None = None,
        board: BoardSpec | None = None,
        platter: PlatterSpec | None = None,
        camera_name: str | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> "Header":
        """The header of a new recording.

        Args:
            size: width and height of the frames, pixels.
            lasers: colour of every laser by name.
            direction: which way the table turns as angles grow, seen from above; None where no frame has an
                angle.
            seconds_per_turn: of a table that turns steadily.
            board: the calibration board, where a frame shows one.
            platter: the markers on the table, where there are any.
            camera_name: free text.
            extra: further keys to keep in the file.
        """
        camera: Json = {"width": size[0], "height": size[1]}
        document: Json = {**(extra or {}), "format": "turnscan-recording", "version": 1, "camera": camera}
        document["lasers"] = [{"name": n, "colour": c} for n, c in (lasers or {}).items()]
        if camera_name is not None:
            camera["name"] = camera_name
        if direction is not None:
            document["turntable"] = {"direction": direction}
            if seconds_per_turn is not None:
                document["turntable"]["seconds_per_turn"] = seconds_per_turn
        if board is not None:
            document["board"] = board_json(board)
        if platter is not None:
            document["platter"] = platter_json(platter)
        return compose(Header, document, "new recording", RecordingError)

    @property
    def camera_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.camera.width, self.camera.height

    def board_spec(self) -> BoardSpec:
        """The calibration board.

        Raises:
            RecordingError: the recording names none.
        """
        if self.board is None:
            raise RecordingError("recording.json: board", "is missing", _BOARD_HINT)
        return self.board.spec()

    def platter_spec(self) -> PlatterSpec:
        """The markers on the table.

        Raises:
            RecordingError: the recording names none.
        """
        if self.platter is None:
            raise RecordingError("recording.json: platter", "is missing", _PLATTER_HINT)
        return self.platter.spec()


class Manifest(Header):
    """A whole `recording.json`."""

    frames: tuple[FrameEntry, ...]

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "Manifest":
        used: set[tuple[str, Role]] = set()
        for number, frame in enumerate(self.frames):
            check_frame(self, frame, f"frames[{number}]")
            if (frame.file, frame.role) in used:
                raise ValueError(
                    f"frames[{number}].file: {frame.file!r} is listed twice with the role {frame.role.value}"
                )
            used.add((frame.file, frame.role))
        return self

    def text(self) -> str:
        """The file, one line for each frame."""
        document = self.as_json()
        frames = document.pop("frames")
        head = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)[:-2]
        lines = ",\n".join("    " + json.dumps(f, ensure_ascii=False, allow_nan=False) for f in frames)
        return f'{head},\n  "frames": [\n{lines}\n  ]\n}}\n'


def check_frame(header: Header, frame: FrameEntry, place: str) -> None:
    """Whether a frame fits what the recording says once.

    Raises:
        ValueError: with the place and the problem.
    """
    known = {laser.name for laser in header.lasers}
    for laser in frame.lasers_on:
        if laser not in known:
            raise ValueError(f"{place}.lasers_on: there is no laser called {laser!r}")
    if frame.angle_deg is not None and header.turntable is None:
        raise ValueError(f"{place}.angle_deg: means nothing without turntable.direction (ccw or cw)")
    if frame.role is Role.SCAN and frame.angle_deg is None and header.platter is None:
        is_steady = header.turntable is not None and header.turntable.seconds_per_turn is not None
        if not is_steady:
            raise ValueError(
                f"{place}.angle_deg: is missing, and there is no turntable.seconds_per_turn beside time_s"
            )
        if frame.time_s is None:
            raise ValueError(f"{place}: needs angle_deg or time_s")
