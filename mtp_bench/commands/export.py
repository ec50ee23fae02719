"""``mtp-bench export``."""

from pathlib import Path
from typing import Annotated

from typer import Option

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
            help="nuScenes: a file (.json); Argoverse 2: a .feather file; "
            "else a folder.",
        ),
    ],
    table: Annotated[
        bool, Option("--table", help="Tables: a folder with a .csv for each scene.")
    ] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write the tracks of a stored run in the formats of other benchmarks.

    The formats are result files of KITTI, nuScenes or Argoverse 2, and tables.
    """
    boxes = export_tracks(open_run(folder, root, env), output, table)
    show(f"{output}: {counted(boxes, 'tracked position')}")
