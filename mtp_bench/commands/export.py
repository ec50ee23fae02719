"""``mtp-bench export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..running.challenge import export_predictions
from ..running.stored import open_run
from ..running.track_export import export_tracks
from ..viz.terminal.output import counted, progress_bar, show
from .completion import words
from .options import DataOption, FolderArgument, RunCardOption, one_of

WHAT = ("tracks", "prediction")


def export(
    what: Annotated[str, typer.Argument(help="tracks or prediction.", autocompletion=words(*WHAT))],
    folder: FolderArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="File (.json) or, of KITTI and tables, folder.")],
    table: Annotated[bool, typer.Option("--table", help="Tracks as tables: a .csv file for each scene.")] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write a stored run as others read it: tracks, or forecasts as the nuScenes prediction challenge takes them."""
    one_of(what, WHAT, "WHAT")
    if table and what != "tracks":
        raise typer.BadParameter("only with tracks", param_hint="--table")
    if what == "prediction" and output.suffix != ".json":
        raise typer.BadParameter(f"{output}: expected a name that ends in .json", param_hint="--output")
    opened = open_run(folder, root, env)
    with progress_bar("export") as progress:
        if what == "tracks":
            said = counted(export_tracks(opened, output, table, progress), "tracked position")
        else:
            done = export_predictions(opened, output, progress)
            targets = counted(done.targets, "official target")
            said = f"predictions of {done.predicted} of {targets}; the others have no forecast in this run"
    show(f"{output}: {said}")
