"""Everything that can go wrong and be told to a person, on one page.

Each error is one sentence naming the thing, and a hint: what to do about it. `exit_code` is what the
command line ends with: 2 for input or circumstances that stopped the work, 1 for a result that was
computed but must not be trusted.
"""


class ScannerError(Exception):
    """What a person is told; never raised itself."""

    code = "scanner-error"
    hint = ""
    exit_code = 2

    def __init__(self, message: str, hint: str | None = None) -> None:
        super().__init__(message)
        if hint is not None:
            self.hint = hint

    @property
    def message(self) -> str:
        return str(self)


class RecordingError(ScannerError):
    """A recording, or one entry of its manifest, cannot be used."""

    code = "recording"
    hint = "Correct the entry, or make the recording again with `turnscan import`."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class FrameError(RecordingError):
    """One picture is missing, truncated, undecodable or of another size."""

    code = "frame"
    hint = "Replace the picture or take its entry out of recording.json."


class CalibrationFileError(ScannerError):
    """A calibration file cannot be used."""

    code = "calibration-file"
    hint = "Calibrate again with `turnscan calibrate`, or name another file."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class CalibrationError(ScannerError):
    """The pictures do not give the calibration that was asked for."""

    code = "calibration"
    hint = "Take more views with the whole board in the picture, tilted in different directions."


class PointCloudFileError(ScannerError):
    """A PLY file cannot be read."""

    code = "point-cloud-file"
    hint = "Name a PLY file with x, y and z for every vertex."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class ReconstructionError(ScannerError):
    """The recording holds nothing that could be turned into points."""

    code = "reconstruction"
    hint = "Check that the recording has scan frames whose laser the calibration knows."


class ImportFailed(ScannerError):  # noqa: N818 (ImportError is taken)
    """Pictures or a video could not be made into a recording."""

    code = "import"
    hint = "Name a folder of PNG or JPEG pictures, or a video file."


class OutputError(ScannerError):
    """A result could not be written."""

    code = "output"
    hint = "Free some space or name another place, then run the command again."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class OptionError(ScannerError):
    """An option has a value that does not work."""

    code = "option"
    hint = "See the command's --help."
