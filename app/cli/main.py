"""`turnscan`: all commands, and the one place where an error becomes a sentence and an exit code."""

import sys

import typer

from app.cli.board import board_command, platter_command
from app.cli.calibrate import calibrate_command
from app.cli.console import console
from app.cli.demo import demo_command
from app.cli.emulate import emulate_command
from app.cli.import_pictures import import_command
from app.cli.reconstruct import reconstruct_command
from app.cli.scan import scan_command
from app.cli.simulate import simulate_command
from app.errors import ScannerError

_INTERRUPTED = _USAGE = 2
# Typer catches the interrupt itself and returns this.
_TYPER_INTERRUPTED = 130
# Typer shows the base of its usage errors nowhere else.
_UsageError: type[Exception] = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)

app = typer.Typer(
    name="turnscan",
    help="A line laser, a camera and a turntable become a 3D scanner.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command("import")(import_command)
app.command("board")(board_command)
app.command("platter")(platter_command)
app.command("calibrate")(calibrate_command)
app.command("reconstruct")(reconstruct_command)
app.command("scan")(scan_command)
app.command("simulate")(simulate_command)
app.command("emulate")(emulate_command)
app.command("demo")(demo_command)


def main() -> None:
    """Run the command line. Exit codes: 0 done, 1 done but not to be trusted, 2 not done."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    try:
        code = app(arguments, prog_name="turnscan", standalone_mode=False)
    except ScannerError as error:
        console.print(f"[bold red]Error:[/] {_plain(error.message)}", soft_wrap=True)
        if error.hint:
            console.print(_plain(error.hint), soft_wrap=True)
        return error.exit_code
    except _UsageError as error:
        if not str(error):
            # The help has been shown in place of an error.
            return 0
        console.print(f"[bold red]Error:[/] {_plain(str(error))}.", soft_wrap=True)
        console.print("See `turnscan --help`, or --help of the command.", soft_wrap=True)
        return _USAGE
    except (KeyboardInterrupt, typer.Abort):
        code = _TYPER_INTERRUPTED
    if code == _TYPER_INTERRUPTED:
        console.print(
            "[bold red]Stopped[/] before the end: no result was written. Run the command again.",
            soft_wrap=True,
        )
        return _INTERRUPTED
    return code if isinstance(code, int) else 0


def _plain(text: str) -> str:
    """Brackets in file names are no markup."""
    return text.replace("[", "\\[")
