"""The command line: the use-cases without a server."""

import typer

app = typer.Typer(no_args_is_help=True, add_completion=True)


def main() -> None:
    app()
