"""Every benchmark in one go: `python -m benchmarks [NAME...]`.

A benchmark is a module `bench_*.py` of this package with `run() -> list[Row]`; names pick some of them.
"""

import importlib
import pkgutil
import sys
import time

from rich.console import Console

import benchmarks
from benchmarks.report import table_of


def main(names: list[str]) -> int:
    """Run and print; 1 where a target was missed."""
    console = Console()
    missed = 0
    for module in pkgutil.iter_modules(benchmarks.__path__):
        name = module.name.removeprefix("bench_")
        if name == module.name or (names and name not in names):
            continue
        start = time.perf_counter()
        rows = importlib.import_module(f"benchmarks.{module.name}").run()
        took_s = time.perf_counter() - start
        missed += sum(row.is_met is False for row in rows)
        console.print(table_of(f"{name.replace('_', ' ')} ({took_s:.0f} s)", rows))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
