"""``mtp-bench import``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..parallel import reported
from ..running.options import RunOptions
from ..sources import open_source, with_tracks
from ..sources.stored_tracks import import_tracks
from ..viz.terminal.output import command_line, counted, show, show_command
from .options import DataOption, EnvOption, ScenesOption, SplitOption
from .output import prepare


def import_(
    file: Annotated[Path, Argument(help="A tracking submission of nuScenes, or KITTI's result files.")],
    env: EnvOption,
    output: Annotated[Path, Option("-o", "--output", help="New folder for the tables.")],
    root: DataOption = None,
    scenes: ScenesOption = None,
    split: SplitOption = None,
) -> None:
    """Write the tracks of another program as tables, one for each scene."""
    options = RunOptions(root, scenes, split=split)
    prepare(env, options)
    card = options.card(env)
    source = with_tracks(open_source(card, root), card, root, file)
    names = options.chosen(source.names)
    with reported("importing tracks") as progress:
        progress.started(len(names))
        number, boxes = import_tracks(source, names, card, output, progress.done)
    show(f"{counted(boxes, 'tracked position')} of {counted(number, 'scene')} in {output}; next:")
    run = command_line("run", "given_tracks", env=env, data=root, scenes=scenes, split=split, tracks=output)
    show_command(f"{run} -o runs/given_tracks")
