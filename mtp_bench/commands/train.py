"""``mtp-bench train``: parameters of the baselines, fitted on training splits."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import DataOption, EnvScenes, JobsOption, TextOption, WorkerChoice, one_of, opened
from .output import prepare, print_or_write, require_writable, working


def motion_noise(
    on: EnvScenes,
    observe: Annotated[str, typer.Option(help="detections or truth: what the pasts are made of.")] = "detections",
    jobs: JobsOption = 0,
    output: TextOption = None,
) -> None:
    """Fit the motion noise of the kinematic predictors on the training split of an environment (or another)."""
    from ..training import motion_noise

    require_writable(output)
    options = on.options(WorkerChoice(jobs)).on_split("train")
    prepare(on.env, options)
    with working("read", options) as watched:
        text = motion_noise.fit_env(on.env, watched, observe)
    print_or_write(output, text)


def presence(
    detector: Annotated[str, typer.Argument(help="Detector of a shipped model.")],
    data: DataOption = None,
    output: TextOption = None,
) -> None:
    """Fit how likely it is that a track's object is there, on the training scenes of a detector."""
    from ..running.options import RunOptions
    from ..training.presence import RECIPES, fit_detector

    require_writable(output)
    one_of(detector, tuple(RECIPES), "DETECTOR")
    options = RunOptions(data)
    for scenes in RECIPES[detector].scenes:
        prepare(scenes.env, scenes.options(options))
    with working("read", options) as watched:
        text = fit_detector(detector, watched)
    print_or_write(output, text)


train = typer.Typer(help="Fit the parameters of a baseline on training splits.", no_args_is_help=True)
train.command("motion-noise")(opened(motion_noise))
train.command("presence")(opened(presence))
