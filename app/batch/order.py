"""What is to be made of every recording, in words that can be sent to another process."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from app.errors import RecordingError
from app.library.item import CALIBRATION_FILE
from app.recording.reader import Recording
from app.recording.shot import Role
from app.surface.finish import Finish


class BatchOrder(BaseModel):
    """How recordings become things.

    Attributes:
        finish: how their clouds are finished.
        calibration: the file for all of them; empty where each is calibrated by itself.
        fallback: the file for those that could not be: they hold neither pictures nor a file for it.
        detector: finds the stripes.
        skips_bad_frames: pictures that cannot be read are left out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    finish: Finish = Finish()
    calibration: str = ""
    fallback: str = ""
    detector: str = "zero-crossing"
    skips_bad_frames: bool = False

    def calibration_for(self, recording: Recording) -> Path | None:
        """The calibration file of a recording; None where its own pictures are to give it.

        Raises:
            RecordingError: there is none, and no pictures either.
        """
        if self.calibration:
            return Path(self.calibration)
        if recording.select(Role.LASER_PLANE, Role.AXIS):
            return None
        beside = recording.folder / CALIBRATION_FILE
        if beside.is_file():
            return beside
        if self.fallback:
            return Path(self.fallback)
        raise RecordingError(
            str(recording.folder), "holds no pictures to calibrate from", "Name a file with --calibration."
        )
