"""The command line: ``mtp-bench``. Exit status 0, 1 for a failure that the message explains, 2 for wrong usage."""

from __future__ import annotations

import warnings

import typer

from ..errors import MtpBenchError
from .board import board
from .check import check
from .compare import compare
from .data import data
from .envs import envs
from .events import events
from .fit_noise import fit_noise
from .freeze import freeze
from .new import new
from .options import Command, opened
from .output import fail
from .run import run
from .score import score
from .seal import seal
from .submit import submit
from .train import train
from .verify import verify
from .video import video
from .view import view

app = typer.Typer(
    help="Tracking and prediction together: your agent sees detections, not the truth.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (
    envs, data, run, score, compare, view, events, video, fit_noise, new, check, submit, verify, seal, board,
):  # fmt: skip
    app.command(cls=Command)(opened(command))
app.add_typer(train, name="train")
app.command(hidden=True)(opened(freeze))


def main() -> None:
    """Entry point: errors of the library become one line and exit status 1."""
    # joblib renews workers that hold much memory, and says so; nothing is lost by it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        app(prog_name="mtp-bench")
    except MtpBenchError as error:
        fail(str(error))
    except OSError as error:  # a full disk, a file without permission
        fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))


if __name__ == "__main__":
    main()
