"""`turnscan serve`: the scanner for programs and pages on this machine."""

import logging
from pathlib import Path
from typing import Annotated

import typer

from app.cli.bench import bench_description
from app.cli.console import say
from app.settings import Settings


def serve_command(
    bench: Annotated[
        str, typer.Option(help="Bench file, or simulated, or simulated:grbl; by default bench.toml.")
    ] = "",
    folder: Annotated[Path, typer.Option(help="Where scans, jobs and calibrations are kept.")] = Path(),
    port: Annotated[int, typer.Option(min=0, max=65535, help="On this machine.")] = 8000,
) -> None:
    """Serve the scanner on this machine until Ctrl-C: its API, live pictures and the 3D view."""
    import uvicorn

    from app.api.versioned import API
    from app.main import create_app
    from app.viewer.proxy import SOCKET_OPTIONS

    description = bench_description(bench)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    settings = Settings(folder, bench or "bench.toml", port)
    application = create_app(settings, description)
    address = f"http://localhost:{port}"
    say([f"Open {address} in a browser on this machine. The API is at {address}{API}. Ctrl-C ends it."])
    uvicorn.run(
        application, host="127.0.0.1", port=port, log_level="warning",
        timeout_graceful_shutdown=5, **SOCKET_OPTIONS,
    )  # fmt: skip
