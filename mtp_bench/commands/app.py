"""The command line: ``mtp-bench``. Exit status 0, 1 for a failure that the message explains, 2 for wrong usage."""

from __future__ import annotations

import io
import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from .._version import __version__
from ..errors import MtpBenchError
from ..files import clean_text
from .board import board
from .challenge import challenge
from .check import check
from .compare import compare
from .data import data
from .envs import envs
from .events import events
from .export import export
from .fit_noise import fit_noise
from .freeze import freeze
from .import_ import import_
from .new import new
from .options import Command, opened
from .output import fail, said_of, say
from .run import run
from .score import score
from .seal import seal
from .study import study
from .submit import submit
from .train import train
from .verify import verify
from .video import video
from .view import view

INTERRUPTED = 130  # exit status, as shells have it
AFTER = {  # command -> what is said after Ctrl-C
    "submit": "scenes that were finished are kept: the same command with --resume goes on",
    "study": "runs that were finished are kept: the same command goes on",
    "train": "where a training keeps its state, the same command goes on from there",
    "data": "what was made so far is kept",
    "verify": "levels and records that were written so far are kept",
    "board": "what was written so far, such as clips, is kept",
}


class InterruptedCommandError(Exception):
    """Someone pressed Ctrl-C."""


class Commands(TyperGroup):
    """All commands; an interruption is told by `main`, in one line, and wrong usage with what was got."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was chosen."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise InterruptedCommandError(AFTER.get(ctx.invoked_subcommand, "nothing was written")) from None
        except typer.BadParameter as error:
            _say_what_was_got(error)
            raise


def _say_what_was_got(error: typer.BadParameter) -> None:
    """Put the value before what pydantic says of it, which names what was expected alone."""
    from pydantic import ValidationError

    if isinstance(error.__cause__, ValidationError):
        got = clean_text(repr(error.__cause__.errors()[0]["input"]), 100)
        error.message = f"got {got}: {error.message}"


app = typer.Typer(cls=Commands, no_args_is_help=True, pretty_exceptions_enable=False)


def _version(asked: bool) -> None:
    if asked:
        print(f"mtp-bench {__version__}")
        raise typer.Exit


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Tracking and prediction together: your agent sees detections, not the truth."""


for command in (
    envs, data, run, score, compare, study, view, events, video, fit_noise, new, check, submit, verify, seal, board,
    export, challenge,
):  # fmt: skip
    app.command(cls=Command)(opened(command))
app.add_typer(train, name="train")
app.add_typer(import_, name="import")
app.command(hidden=True)(opened(freeze))


def main() -> None:
    """Entry point: errors of the library become one line and exit status 1, Ctrl-C one line and 130."""
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  (it was closed)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text
    # joblib renews workers that hold much memory, and says so; nothing is lost by it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        app(prog_name="mtp-bench")
    except (MtpBenchError, OSError) as error:
        fail(said_of(error))
    except InterruptedCommandError as interruption:
        say(f"interrupted; {interruption}")
        raise SystemExit(INTERRUPTED) from None


if __name__ == "__main__":
    main()
