"""What the server is told when it starts."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Settings:
    """Plain values; whoever starts the server makes them.

    Attributes:
        folder: holds `scans/`, `jobs/` and `calibration_store/`; made where it is missing.
        bench_spec: a bench file, or `simulated`.
        port: on the loopback interface.
    """

    folder: Path
    bench_spec: str = "simulated"
    port: int = 8000

    @property
    def scans(self) -> Path:
        return self.folder / "scans"

    @property
    def jobs(self) -> Path:
        return self.folder / "jobs"

    @property
    def calibrations(self) -> Path:
        return self.folder / "calibration_store"
