"""``mtp-bench export``."""

from pathlib import Path
from typing import Annotated

from typer import Option

from ..core import reported
from ..running import export_tracks, open_run
from ..viz import counted, show
from .options import DataOption, FolderArgument, RunCardOption


def export(
    folder: FolderArgument,
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            help="nuScenes: a file (.json); Argoverse 2: a .feather file; else a folder.",
        ),
    ],
    table: Annotated[
        bool, Option("--table", help="Tables: a folder with a .csv for each scene.")
    ] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write the tracks of a stored run as result files of KITTI, nuScenes or Argoverse 2, or as tables."""
    opened = open_run(folder, root, env)
    with reported("exporting tracks") as progress:
        boxes = export_tracks(opened, output, table, progress)
    show(f"{output}: {counted(boxes, 'tracked position')}")
