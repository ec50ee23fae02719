"""``mtp-bench import``: recordings and forecasts of other programs."""

from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option, Typer

from ..core import long_work
from ..running import import_forecasts
from ..sources import import_logs
from ..viz import command_line, counted, show, show_command, show_lines
from .options import (
    EnvScenes,
    with_expanded_options,
)

import_ = Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Recordings and forecasts of other programs.",
)
# above which scenes are played by the environment of 10 Hz
MAX_SLOW_RATE_HZ = 5
OutputOption = Annotated[
    Path, Option("-o", "--output", help="New folder for the tables.")
]


@import_.command()
@with_expanded_options
def forecasts(
    file: Annotated[
        Path, Argument(help="The file, or a folder with a table for each scene.")
    ],
    on: EnvScenes,
    form: Annotated[
        str,
        Option(
            help="nuScenes: mfeval, uniad, vip3d or vad; Argoverse 2: av2; "
            "everywhere: table."
        ),
    ],
    output: Annotated[
        Path | None, Option("-o", "--output", help="Folder of the run.")
    ] = None,
    is_dry_run: Annotated[
        bool, Option("--dry-run", help="Check the file, and write nothing.")
    ] = False,
    classes: Annotated[
        str | None, Option(help="Score these classes alone, such as car,bus.")
    ] = None,
    rate: Annotated[
        float | None,
        Option(min=0.1, max=100, help="Hz of the file's steps, if not the form's."),
    ] = None,
    constant_confidence: Annotated[
        bool,
        Option("--constant-confidence", help="Take objects that are all equally sure."),
    ] = False,
    own_detections: Annotated[
        bool,
        Option(
            "--own-detections",
            help="The file's objects stand in for the detections of the environment.",
        ),
    ] = False,
    force: Annotated[
        bool, Option("--force", help="Replace an earlier run in that folder.")
    ] = False,
) -> None:
    """Store the forecasts of another program as a run, which is never ranked."""
    if (output is None) != is_dry_run:
        raise BadParameter("name a folder, or --dry-run", param_hint="--output")
    lines = import_forecasts(
        file,
        on.env,
        form,
        output,
        on.options(),
        rate=rate,
        constant_confidence=constant_confidence,
        own_detections=own_detections,
        classes=None if classes is None else classes.split(","),
        force=force,
    )
    show_lines(lines)
    if output is not None:
        show_command(command_line("score", str(output), data=on.data))


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
    """Write driving logs of 123D as own scenes, which --files plays.

    They have true boxes, the ego and lanes.
    """
    with long_work("importing logs") as progress:
        counts = import_logs(folder, output, rate, reach, progress.done)
    boxes = (
        f"{counted(counts['truth'], 'box', 'es')} in {counted(counts['ego'], 'frame')}"
    )
    lanes = f"{counted(counts['lanes'], 'lane')} in {output}"
    show(f"{counted(counts['logs'], 'log')} with {boxes} and {lanes}; next:")
    env = "MTP-AV2-10Hz-v0" if rate > MAX_SLOW_RATE_HZ else "MTP-AV2-v0"
    study_command = command_line("study", env=env, files=output)
    show_command(f"{study_command} --quick -o study")
