"""`turnscan`: all commands, and the one place where an error becomes a sentence and an exit code."""

import sys
from collections.abc import Iterable
from importlib import import_module

import typer

from app.cli.console import console
from app.errors import ScannerError

# Imported when they are run: many need libraries that take a second to load. Either a function or, for a
# command with commands of its own, a `typer.Typer`.
_COMMANDS = {
    "import": "app.cli.import_pictures:import_command",
    "board": "app.cli.board:board_command",
    "platter": "app.cli.board:platter_command",
    "calibrate": "app.cli.calibrate:calibrate_command",
    "calibrations": "app.cli.calibrations:calibrations_app",
    "devices": "app.cli.devices:devices_command",
    "doctor": "app.cli.doctor:doctor_command",
    "scan": "app.cli.scan:scan_command",
    "password": "app.cli.password:password_app",
    "serve": "app.cli.serve:serve_command",
    "reconstruct": "app.cli.reconstruct:reconstruct_command",
    "batch": "app.cli.batch:batch_command",
    "surface": "app.cli.surface:surface_command",
    "library": "app.cli.library:library_app",
    "measure": "app.cli.measure:measure_command",
    "simulate": "app.cli.simulate:simulate_command",
    "emulate": "app.cli.emulate:emulate_command",
    "demo": "app.cli.demo:demo_command",
}
_INTERRUPTED = _USAGE = 2
# Typer catches the interrupt itself and returns this.
_TYPER_INTERRUPTED = 130
# Typer shows the base of its usage errors nowhere else.
_UsageError: type[Exception] = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)


def main() -> None:
    """Run the command line. Exit codes: 0 done, 1 done but not to be trusted, 2 not done."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    try:
        wanted = arguments[:1] if arguments and arguments[0] in _COMMANDS else _COMMANDS
        code = _application(wanted)(arguments, prog_name="turnscan", standalone_mode=False)
    except ScannerError as error:
        console.print(f"[bold red]Error:[/] {_plain(error.message)}", soft_wrap=True)
        if error.hint:
            console.print(_plain(error.hint), soft_wrap=True)
        return error.exit_code
    except _UsageError as error:
        if not str(error):
            # The help has been shown in place of an error.
            return 0
        console.print(f"[bold red]Error:[/] {_plain(str(error).rstrip('.'))}.", soft_wrap=True)
        console.print("See `turnscan --help`, or --help of the command.", soft_wrap=True)
        return _USAGE
    except MemoryError:
        console.print("[bold red]Error:[/] There is too little memory for this.", soft_wrap=True)
        console.print("Use fewer points or a coarser detail, or close other programs.", soft_wrap=True)
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


def _application(commands: Iterable[str]) -> typer.Typer:
    """The command line with these commands."""
    application = typer.Typer(
        name="turnscan",
        help="A line laser, a camera and a turntable become a 3D scanner.",
        no_args_is_help=True,
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
    )

    @application.callback()
    def keep_names() -> None:
        """Without this, a single command would lose its name."""

    for name in commands:
        module, attribute = _COMMANDS[name].split(":")
        command = getattr(import_module(module), attribute)
        if isinstance(command, typer.Typer):
            application.add_typer(command, name=name)
        else:
            application.command(name)(command)
    return application


def _plain(text: str) -> str:
    """Brackets in file names are no markup."""
    return text.replace("[", "\\[")
