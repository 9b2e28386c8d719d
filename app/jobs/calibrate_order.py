"""What kind of calibration is wanted; kept beside its pictures, so that it can be gone on with."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from app.calibration.capture import CapturePlan
from app.calibration.capture_camera import CameraLimits
from app.calibration.plan import CalibrationPlan
from app.calibration.record import CalibrationRecord
from app.documents import Entry, read_document
from app.errors import CalibrationError, OptionError, RecordingError
from app.files import make_folder, write_whole
from app.jobs.calibrate_state import Kind, Step
from app.recording.manifest_facts import BoardFacts, board_json
from app.vision.board import BoardSpec

ORDER_FILE = "calibration-order.json"
Hands = Literal["person", "simulated"]
# Poses of the board before the lasers, by hand; the paper takes as many.
_LASER_POSES = 5
PLACEMENTS = 2
"""Of the board on the table."""
_LONGEST_S = 1800.0
_STEPS: dict[Kind, tuple[Step, ...]] = {
    Kind.AUTOMATIC: (Step.BOARD, Step.PROOF, Step.TABLE, Step.SOLVING, Step.PROVING),
    Kind.FULL: (Step.CAMERA, Step.BOARD, Step.PROOF, Step.TABLE, Step.SOLVING, Step.PROVING),
    Kind.CAMERA: (Step.CAMERA, Step.SOLVING),
    Kind.TABLE: (Step.BOARD, Step.PROOF, Step.TABLE, Step.SOLVING, Step.PROVING),
    Kind.PAPER: (
        Step.CAMERA, Step.LASERS, Step.BOARD, Step.PROOF, Step.TABLE, Step.SOLVING, Step.PROVING,
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class CalibrationOrder:
    """A calibration that somebody wants.

    Attributes:
        folder: of its pictures; its name is that of the session.
        kind: how.
        board: that is shown.
        camera: taken as it is, of kind `table`.
        hands: who shows the board: a person, who says when it is done, or a simulated pair of hands.
        calibration: name of what came of it; empty before.
    """

    folder: Path
    kind: Kind
    board: BoardSpec
    camera: CalibrationRecord | None = None
    hands: Hands = "person"
    calibration: str = ""

    @property
    def steps(self) -> tuple[Step, ...]:
        return (*_STEPS[self.kind], Step.DONE)

    @property
    def detector(self) -> str:
        """Name of what finds the stripes."""
        return "threshold" if self.kind is Kind.PAPER else "zero-crossing"

    def capture_plan(self, limits: CameraLimits) -> CapturePlan:
        """What is taken; the limits' own time is for people who stand before a terminal."""
        needs_table = Step.BOARD in self.steps
        return CapturePlan(
            with_camera=Step.CAMERA in self.steps,
            laser_poses=_LASER_POSES if Step.LASERS in self.steps else 0,
            placements=PLACEMENTS if needs_table else 0,
            with_proof=needs_table,
            with_empty_table=needs_table,
            limits=replace(limits, seconds=_LONGEST_S),
        )

    def calibration_plan(self) -> CalibrationPlan:
        """How it is computed.

        Raises:
            CalibrationError: the camera that is to be taken is unknown.
        """
        if self.kind is Kind.PAPER:
            return CalibrationPlan("paper", "board")
        if self.kind is not Kind.TABLE:
            return CalibrationPlan()
        if self.camera is None:
            raise CalibrationError(
                "The camera is not calibrated yet, so lasers and axis cannot be calibrated alone.",
                "Calibrate the camera first, or everything at once.",
            )
        return CalibrationPlan(camera=self.camera.camera)

    def save(self) -> None:
        """Keep it in the folder, which is made.

        Raises:
            OutputError: it cannot be written.
        """
        make_folder(self.folder)
        document = {
            "kind": self.kind.value,
            "board": board_json(self.board),
            "hands": self.hands,
            "calibration": self.calibration,
        }
        if self.camera is not None:
            document["camera"] = json.loads(self.camera.to_bytes())
        write_whole(self.folder / ORDER_FILE, json.dumps(document, indent=1).encode() + b"\n")

    @classmethod
    def load(cls, folder: Path) -> "CalibrationOrder":
        """As it was kept.

        Raises:
            RecordingError: there is none, or it cannot be read.
        """
        path = folder / ORDER_FILE
        document = read_document(path, _Document, RecordingError)
        camera = None
        if document.camera is not None:
            camera = CalibrationRecord.parse(json.dumps(document.camera).encode(), str(path))
        try:
            kind = Kind(document.kind)
        except ValueError as error:
            raise RecordingError(f"{path}: kind", f"is none: {document.kind!r}") from error
        return cls(folder, kind, document.board.spec(), camera, document.hands, document.calibration)


class _Document(Entry):
    kind: str
    board: BoardFacts
    hands: Hands = "person"
    calibration: str = ""
    camera: dict[str, object] | None = None


def board_as_measured(board: BoardSpec, ruler_mm: float) -> BoardSpec:
    """The board at the scale it was printed: its ruler of 100 mm measures so much.

    Raises:
        OptionError: no printer is so wrong.
    """
    if not 50.0 <= ruler_mm <= 200.0:
        raise OptionError(
            f"A ruler of 100 mm that measures {ruler_mm:g} mm cannot be.", "Give what you measure, in mm."
        )
    scale = ruler_mm / 100.0
    return replace(board, spacing_mm=board.spacing_mm * scale, marker_mm=board.marker_mm * scale)
