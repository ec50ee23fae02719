"""``mtp-bench import``: other recordings as folders of own scenes, each with a card."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from ..cards import Card, load_card, profile_of_stored
from ..running.options import RunOptions
from ..sources import load_scenes, open_source, with_tracks
from ..sources.base import require_classes
from ..sources.importing import KittiText, import_scenes, import_tracks, kitti_scenes
from ..sources.kitti.layout import TYPES
from ..sources.kitti.poses import FRAME_PERIOD
from ..types import Scene
from ..viz.terminal.output import command_line, counted, progress_bar, show, show_command
from .completion import words
from .options import DataOption, ScenesOption, SplitOption, one_of
from .output import prepare

FolderOption = Annotated[Path, typer.Option("-o", "--output", help="New folder for the scenes and their card.")]
FORMS = ("csv", "parquet")
RATE = "Frames per second. Default: KITTI's own, a frame each 0.1036 s."
FormOption = Annotated[str, typer.Option("--form", help="csv or parquet.", autocompletion=words(*FORMS))]

import_ = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Turn other recordings into own scenes.",
)


@import_.command()
def kitti(
    labels: Annotated[Path, typer.Option(help="Folder of true boxes with ids, as label_02/0001.txt.")],
    output: FolderOption,
    detections: Annotated[
        Path | None,
        typer.Option(help="Folder of detections: rows as the labels' and a score, or AB3DMOT's Car/0001.txt."),
    ] = None,
    oxts: Annotated[Path | None, typer.Option(help="Folder of GPS/IMU data; needs --calib.")] = None,
    calib: Annotated[
        Path | None,
        typer.Option(help="Folder of calibrations from the GPS/IMU unit to the camera."),
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(help="Folder of camera poses, as in KITTI's odometry benchmark.")
    ] = None,
    rate: Annotated[float | None, typer.Option(min=0.1, max=1000, help=RATE)] = None,
    env: Annotated[str, typer.Option("--env", help="Environment whose rules the card takes.")] = "MTP-KITTI-v0",
    form: FormOption = "csv",
) -> None:
    """Import text in the columns of KITTI's tracking benchmark."""
    one_of(form, FORMS, "--form")
    period = 1 / rate if rate else FRAME_PERIOD
    text = KittiText(labels, detections, oxts, calib, poses, period)
    card = load_card(env)
    require_classes(card, "KITTI", TYPES)
    detector = profile_of_stored(card) if detections is None else ""
    _write(kitti_scenes(text, card.task.classes), card, output, text.posed, form, detector)


@import_.command()
def nuscenes(
    file: Annotated[Path, typer.Argument(help="Detections in the official submission form.")],
    output: FolderOption,
    env: Annotated[
        str, typer.Option("--env", help="Environment of nuScenes: its scenes, truth and rules.")
    ] = "MTP-nuScenes-mini-v0",
    root: DataOption = None,
    split: SplitOption = None,
    form: FormOption = "csv",
) -> None:
    """Import the scenes of nuScenes with the detections of a submission."""
    one_of(form, FORMS, "--form")
    options = RunOptions(root, split=split, detection_file=str(file.expanduser().absolute()))
    prepare(env, options)
    card = options.card(env)
    _write(load_scenes(card, root), card, output, True, form)


@import_.command()
def tracks(
    file: Annotated[Path, typer.Argument(help="A tracking submission of nuScenes, or KITTI's result files.")],
    env: Annotated[str, typer.Option("--env", help="Environment or card whose scenes they are of.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="New folder for the tables.")],
    root: DataOption = None,
    scenes: ScenesOption = None,
    split: SplitOption = None,
) -> None:
    """Import tracks of another program as tables, one for each scene."""
    options = RunOptions(root, scenes, split=split)
    prepare(env, options)
    card = options.card(env)
    source = with_tracks(open_source(card, root), card, root, file)
    names = options.chosen(source.names)
    with progress_bar("import") as progress:
        progress.started(len(names))
        number, boxes = import_tracks(source, names, card, output, progress.done)
    show(f"{counted(boxes, 'tracked position')} of {counted(number, 'scene')} in {output}; next:")
    run = command_line("run", "given_tracks", env=env, data=root, scenes=scenes, split=split, tracks=output)
    show_command(f"{run} -o runs/given_tracks")


def _write(scenes: Iterator[Scene], card: Card, output: Path, posed: bool, form: str, detector: str = "") -> None:
    """Write the scenes and say how to run them; ``detector``: the profile that they need, where they have none."""
    with progress_bar("import") as progress:
        number, path = import_scenes(scenes, card, output, posed, form, progress.done)  # type: ignore[arg-type]  # one of FORMS
    show(f"{counted(number, 'scene')} and their card {path.name} in {output}; next:")
    show_command(f"{command_line('run', 'stp', env=path, detector=detector or None)} -o runs/{path.stem}")
