"""The most memory a process ever had."""

import resource
import subprocess
import sys
from pathlib import Path


def own_peak_mb() -> float:
    """Of this process since it was started.

    The kernel's own count where it can be read: what getrusage tells begins with the size of the parent.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def peak_mb_of(module: str, *arguments: str) -> float:
    """Run a module that prints its own peak last."""
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])
