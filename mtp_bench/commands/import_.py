"""``mtp-bench import``: recordings and tracks of other programs as tables."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from ..core import long_work
from ..running import RunOptions
from ..sources import import_logs, import_tracks, open_source, with_tracks
from ..viz import command_line, counted, show, show_command
from .options import DataOption, EnvOption, ScenesOption, SplitOption
from .output import prepare

import_ = Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Tables from other programs.",
)
OutputOption = Annotated[
    Path, Option("-o", "--output", help="New folder for the tables.")
]


@import_.command()
def tracks(
    file: Annotated[
        Path,
        Argument(help="A tracking submission of nuScenes, or KITTI's result files."),
    ],
    env: EnvOption,
    output: OutputOption,
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
    with long_work("importing tracks") as progress:
        progress.started(len(names))
        number, boxes = import_tracks(source, names, card, output, progress.done)
    show(
        f"{counted(boxes, 'tracked position')} of {counted(number, 'scene')} in {output}; next:"
    )
    run = command_line(
        "run",
        "given_tracks",
        env=env,
        data=root,
        scenes=scenes,
        split=split,
        tracks=output,
    )
    show_command(f"{run} -o runs/given_tracks")


@import_.command("123d")
def logs(
    folder: Annotated[
        Path, Argument(help="A log in the Arrow form of 123D, or a folder of logs.")
    ],
    output: OutputOption,
    rate: Annotated[
        float, Option(min=0.1, max=100, help="Frames per second, such as 2 or 10.")
    ] = 2.0,
    reach: Annotated[
        float,
        Option(min=1, max=1000, help="m from the ego: as far as the detector sees."),
    ] = 60.0,
) -> None:
    """Write driving logs of 123D as own scenes, which --files plays: true boxes, the ego and lanes."""
    with long_work("importing logs") as progress:
        found = import_logs(folder, output, rate, reach, progress.done)
    content = (
        f"{counted(found['truth'], 'box', 'es')} in {counted(found['ego'], 'frame')}"
    )
    show(
        f"{counted(found['logs'], 'log')} with {content} and {counted(found['lanes'], 'lane')} in {output}; next:"
    )
    env = "MTP-AV2-10Hz-v0" if rate > 5 else "MTP-AV2-v0"
    show_command(f"{command_line('study', env=env, files=output)} --quick -o study")
