"""Everything that can go wrong and be told to a person, on one page.

Each error is one sentence naming the thing, and a hint: what to do about it. `exit_code` is what the
command line ends with: 2 for input or circumstances that stopped the work, 1 for a result that was
computed but must not be trusted.
"""

import math


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


class SurfaceError(ScannerError):
    """A cloud cannot be cleaned, joined or made a surface."""

    code = "surface"
    hint = "Look at the cloud in the 3D view."


class ReconstructionError(ScannerError):
    """The recording holds nothing that could be turned into points."""

    code = "reconstruction"
    hint = "Check that the recording has scan frames whose laser the calibration knows."


class ImportFailed(ScannerError):
    """Pictures or a video could not be made into a recording."""

    code = "import"
    hint = "Name a folder of PNG or JPEG pictures, or a video file."


class LibraryError(ScannerError):
    """Something cannot be done with a scan of the library."""

    code = "library"
    hint = "See what is there with `turnscan library list`."


class ScanNotFound(LibraryError):
    """The library, or its bin, holds nothing of that name."""

    code = "scan-not-found"


class ScanBusy(LibraryError):
    """A scan that is being taken is neither moved nor copied."""

    code = "scan-busy"
    hint = "Wait until the scan has ended, or stop it."


class BinChanged(LibraryError):
    """What is to be erased for good is not what the person was asked about."""

    code = "bin-changed"
    hint = "Look at the bin again, then erase."


class TooLarge(LibraryError):
    """What is sent is larger than this server takes."""

    code = "too-large"
    hint = "Copy it into the folder of the library on the scanner's own computer."


class OutputError(ScannerError):
    """A result could not be written."""

    code = "output"
    hint = "Free some space or name another place, then run the command again."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class NoRoom(OutputError):
    """The disk has less room than a scan will take."""

    code = "no-room"
    hint = "Empty the bin, delete scans that are not needed, or take fewer stops."

    def __init__(self, where: str, wanted_bytes: int, free_bytes: int) -> None:
        problem = f"the scan takes about {_megabytes(wanted_bytes)}, and {_megabytes(free_bytes)} are free"
        super().__init__(where, problem)
        self.wanted_bytes, self.free_bytes = wanted_bytes, free_bytes


class OptionError(ScannerError):
    """An option has a value that does not work."""

    code = "option"
    hint = "See the command's --help."


class DeviceError(ScannerError):
    """A camera or a controller board does not do what it should."""

    code = "device"
    hint = "Check the cable and the power supply, then connect again."

    def __init__(self, device: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{device}: {problem}", hint)
        self.device, self.problem = device, problem


class DeviceNotFound(DeviceError):
    """Nothing is there under that name."""

    code = "device-not-found"
    hint = "Plug it in, or choose one that `turnscan devices` lists."


class DeviceDenied(DeviceError):
    """It is there, but another program has it or this user may not open it."""

    code = "device-denied"
    hint = "Close the other program that uses it."


class DeviceUnrecognised(DeviceError):
    """Something answers, or nothing does, but not what the driver expects."""

    code = "device-unrecognised"
    hint = "Run `turnscan devices` to see what is connected, or choose another driver or baud rate."


class DeviceLost(DeviceError):
    """It was there and has gone: unplugged, switched off or reset."""

    code = "device-lost"
    hint = "Plug it in again; the scan can go on from its last picture."


class DeviceTimeout(DeviceError):
    """It did not answer in time."""

    code = "device-timeout"

    def __init__(self, device: str, command: str, timeout_s: float, hint: str | None = None) -> None:
        super().__init__(device, f"did not answer {command!r} within {timeout_s:.3g} s", hint)
        self.command, self.timeout_s = command, timeout_s


class DeviceRefused(DeviceError):
    """It answered with an error, or what was asked is beyond it."""

    code = "device-refused"
    hint = "Choose another value, or check the driver's options in the bench file."


class PositionUnknown(DeviceError):
    """The table was moving when its board was lost, and nobody knows where it stopped."""

    code = "position-unknown"
    hint = "Go on only if the object may be a little turned, or start the scan again."

    def __init__(self, device: str, lowest_deg: float, highest_deg: float) -> None:
        super().__init__(
            device,
            f"lost its position; the table stands between {lowest_deg:.2f} and {highest_deg:.2f} degrees",
        )
        self.lowest_deg, self.highest_deg = lowest_deg, highest_deg


class MoveStopped(DeviceError):
    """A move ended early because somebody stopped it; the position is known."""

    code = "move-stopped"
    hint = "Start the move again when it is safe."


class TurnBrokenOff(DeviceError):
    """A steady turn ended before its end; a scan takes it up again at its last picture."""

    code = "turn-broken-off"
    hint = "Turn more slowly, or at a smaller picture size."


class BenchBusy(ScannerError):
    """A job holds the bench, and it serves one job at a time."""

    code = "bench-busy"
    hint = "Wait until that job has ended, or cancel it."


class JobRuns(ScannerError):
    """A job that has not ended is not taken off the list."""

    code = "job-runs"
    hint = "Cancel it first."


class BenchFileError(ScannerError):
    """The file that describes the bench cannot be used."""

    code = "bench-file"
    hint = "Correct the entry, or write a new file with `turnscan devices --write bench.toml`."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class NotNow(ScannerError):
    """It can be done, but not at this moment."""

    code = "not-now"
    hint = "Wait until it is asked for."


class NotThere(ScannerError):
    """What the address names is not there."""

    code = "not-there"
    hint = "Ask for the list it should be in."


class AccessFileError(ScannerError):
    """The file that says who may use the server cannot be used; nobody is let in then."""

    code = "access-file"
    hint = "Remove the password with `turnscan password --remove`, and set a new one."

    def __init__(self, where: str, problem: str, hint: str | None = None) -> None:
        super().__init__(f"{where}: {problem}", hint)
        self.where, self.problem = where, problem


class NotLetIn(ScannerError):
    """Somebody has to show who he is first."""

    code = "not-logged-in"
    hint = "Log in, or send a valid token."


class WrongPassword(NotLetIn):
    """It is not the one that is set."""

    code = "wrong-password"
    hint = "Try again; a new one is set with `turnscan password` where the server runs."

    def __init__(self) -> None:
        super().__init__("That is not the password.")


class KeyRefused(NotLetIn):
    """A one-time key that does not open, or not any more."""

    code = "key-refused"
    hint = "Log in with the password, or have the server show a new code."

    def __init__(self) -> None:
        super().__init__("This link has been used already, or is older than ten minutes.")


class PersonNeeded(ScannerError):
    """A program asks for what only somebody who has logged in may do."""

    code = "person-needed"
    hint = "Log in with the password, or use `turnscan password` where the server runs."


class RefusedHere(ScannerError):
    """Neither this caller nor this page is served."""

    code = "forbidden"


class BodyTooLarge(ScannerError):
    """More is sent than is taken before the login."""

    code = "body-too-large"
    hint = "Log in first."


class TooManyAttempts(ScannerError):
    """Passwords are tried too fast."""

    code = "too-many-attempts"

    def __init__(self, wait_s: float) -> None:
        wait = max(1, math.ceil(wait_s))
        super().__init__(
            "There were too many attempts to log in.", f"Try again in {wait} second{'s' * (wait > 1)}."
        )
        self.wait_s = wait


class PasswordUnfit(ScannerError):
    """A new password that protects too little."""

    code = "password-unfit"
    hint = "Choose another, or have one made with `turnscan password --new`."


class NoPassword(ScannerError):
    """Something needs a password, and none is set."""

    code = "no-password"
    hint = "Set one with `turnscan password`."

    def __init__(self) -> None:
        super().__init__("No password is set, so nobody logs in.")


def _megabytes(count: int) -> str:
    return f"{count / 1e6:,.0f} MB"
