"""A scan whose program is killed, again and again, is the scan it would have been."""

import random
import tempfile
from pathlib import Path

from benchmarks.killed_scans import KilledServer, scan_with_kills
from benchmarks.report import Row, at_most

_SCANS, _KILLS, _STEPS = 10, 5, 24


def run() -> list[Row]:
    """Ten scans of 72 pictures, each killed five times, beside one that is left alone."""
    chance = random.Random(20261121)
    with tempfile.TemporaryDirectory() as folder:
        server = KilledServer(Path(folder))
        try:
            server.start()
            whole = scan_with_kills(server, "whole", _STEPS, 0, chance)
            killed = [scan_with_kills(server, f"killed {n}", _STEPS, _KILLS, chance) for n in range(_SCANS)]
        finally:
            server.kill()
    kills = sum(each.kills for each in killed)
    failed = [words for each in killed for words in each.not_resumed]
    missing = sum(abs(each.shots - whole.shots) + each.repeated for each in killed)
    points = max(abs(each.points / whole.points - 1.0) for each in killed)
    note = f"unbroken: {whole.points} points, {whole.rms_mm:.3f} mm, {whole.seen_off_deg:.3f} degrees"
    return [
        at_most("kills after which a scan did not go on", float(len(failed)), f"of {kills}", 0.0,
                "; ".join(failed[:2])),
        at_most("pictures missing or taken twice", float(missing), "pictures", 0.0),
        at_most("pictures in flight that were taken again", float(sum(each.in_vain for each in killed)),
                "pictures", float(kills)),
        at_most("angles, largest distance from the plan", max(e.off_deg for e in killed), "degrees", 0.06),
        at_most("the same, as the markers show it, beyond the unbroken scan's",
                max(each.seen_off_deg for each in killed) - whole.seen_off_deg, "degrees", 0.1),
        at_most("points, difference to the unbroken scan", 100.0 * points, "%", 2.0, note),
        at_most("distance from the true ball, RMS, against the unbroken scan's",
                max(each.rms_mm for each in killed) / whole.rms_mm, "times", 1.1),
    ]  # fmt: skip
