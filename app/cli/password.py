"""`turnscan password`: who may use the server, from the machine that it runs on."""

import sys
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from app.access.access import Access
from app.cli.console import console, say
from app.errors import OptionError

password_app = typer.Typer(
    help="Set the password of the server, and make tokens for programs.", invoke_without_command=True
)
_tokens_app = typer.Typer(help="Tokens, by which programs are let in.", no_args_is_help=True)
password_app.add_typer(_tokens_app, name="tokens")

_Folder = Annotated[Path | None, typer.Option(help="The one that is served; by default where you are.")]
_Name = Annotated[str, typer.Argument(help="What the token is for.")]


@password_app.callback()
def password_command(
    context: typer.Context,
    folder: _Folder = None,
    new: Annotated[bool, typer.Option("--new", help="Make a strong one and show it.")] = False,
    remove: Annotated[
        bool,
        typer.Option("--remove", help="Take it away, with all tokens: only this machine is served then."),
    ] = False,
) -> None:
    """Set or change the password of the server: asked for twice, or read from standard input.

    Every browser has to log in again. A server that runs takes it over within a second.
    """
    context.obj = folder
    if context.invoked_subcommand is not None:
        if new or remove:
            raise OptionError(
                "--new and --remove do not go with tokens.", "Give one command after the other."
            )
        return
    if new and remove:
        raise OptionError("--new and --remove exclude each other.")
    if remove:
        Access(folder or Path()).forget_password()
        say(["There is no password any more: the server answers this machine only."])
    elif new:
        password = Access.open(folder or Path()).make_password()
        say(["The new password, which is shown this once:"])
        sys.stdout.write(f"{password}\n")
    else:
        access = Access.open(folder or Path())
        access.set_password(_asked())
        say(["The password is set; every browser has to log in with it."])


@_tokens_app.command("make")
def make_command(context: typer.Context, name: _Name, folder: _Folder = None) -> None:
    """Make a token for a program, and show it this once."""
    secret = _access(context, folder).make_token(name)
    say(["The token, to be sent as `Authorization: Bearer TOKEN`. It is shown this once:"])
    sys.stdout.write(f"{secret}\n")


@_tokens_app.command("list")
def list_command(context: typer.Context, folder: _Folder = None) -> None:
    """Show the names of all tokens, and when they were used last."""
    tokens = _access(context, folder).tokens()
    if not tokens:
        say(["There are no tokens."])
        return
    table = Table("name", "made", "last used")
    for each in tokens:
        table.add_row(each.name, _when(each.created), _when(each.last_used))
    console.print(table)


@_tokens_app.command("end")
def end_command(context: typer.Context, name: _Name, folder: _Folder = None) -> None:
    """End a token: it opens nothing any more."""
    _access(context, folder).end_token(name)
    say([f"The token {name!r} has ended."])


def _access(context: typer.Context, folder: Path | None) -> Access:
    return Access.open(folder or context.obj or Path())


def _asked() -> str:
    if sys.stdin.isatty():
        return str(typer.prompt("New password", hide_input=True, confirmation_prompt=True, err=True))
    return sys.stdin.readline().rstrip("\r\n")


def _when(time: datetime | None) -> str:
    return "never" if time is None else time.astimezone().strftime("%Y-%m-%d %H:%M")
