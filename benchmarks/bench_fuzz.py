"""Requests made up from the API's description, fitting and not: none may be answered by a surprise."""

import tempfile
import warnings
from pathlib import Path

from benchmarks.fuzzed import Fuzzer
from benchmarks.report import Row, at_most
from benchmarks.served import served

_EXAMPLES = 50
_SMALL = {"width": 320, "height": 240, "rate": 20.0}


def run() -> list[Row]:
    with (
        tempfile.TemporaryDirectory() as folder,
        served(Path(folder), **_SMALL) as address,
        warnings.catch_warnings(),
    ):
        # Of the generator of requests, not of ours.
        warnings.simplefilter("ignore")
        found = Fuzzer(address).run(_EXAMPLES)
    statuses = ", ".join(f"{count} x {status}" for status, count in sorted(found.statuses.items()))
    return [
        Row("operations", found.operations, ""),
        Row("requests", found.requests, "", note=statuses),
        Row("slowest answer", found.slowest_s, "s", note=found.slowest),
        at_most("answers that should not be", len(found.faults), "", 0, "\n".join(found.faults[:5])),
    ]
