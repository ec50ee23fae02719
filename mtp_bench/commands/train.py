"""``mtp-bench train``: parameters of the baselines, fitted on training splits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import DataOption, EnvScenes, JobsOption, TextOption, WorkerChoice, one_of, opened
from .output import prepare, print_or_write, require_writable, working

if TYPE_CHECKING:
    from ..running.options import RunOptions
    from ..training.motion_noise import Fit


ObserveOption = Annotated[str, typer.Option(help="detections or truth: what the pasts are made of.")]


def motion_noise(
    on: EnvScenes, observe: ObserveOption = "detections", jobs: JobsOption = 0, output: TextOption = None
) -> None:
    """Fit the motion noise of the kinematic predictors on the training split of an environment (or another)."""
    from ..training.motion_noise import fit_motion_noise

    _noise(on, observe, jobs, output, fit_motion_noise)


def imm_noise(
    on: EnvScenes, observe: ObserveOption = "detections", jobs: JobsOption = 0, output: TextOption = None
) -> None:
    """Fit the noise of the three motion models of the IMM predictor, on the training split or another."""
    from ..training.imm_noise import fit_imm_noise

    _noise(on, observe, jobs, output, fit_imm_noise)


def _noise(on: EnvScenes, observe: str, jobs: int, output: Path | None, fit: Fit) -> None:
    from ..training.motion_noise import fit_env

    require_writable(output)
    options = on.options(WorkerChoice(jobs)).on_split("train")
    prepare(on.env, options)
    with working("read", options) as watched:
        text = fit_env(on.env, watched, observe, fit)
    print_or_write(output, text)


DetectorArgument = Annotated[str, typer.Argument(help="A detector whose training scenes are known.")]


def presence(detector: DetectorArgument, data: DataOption = None, output: TextOption = None) -> None:
    """Fit how likely it is that a track's object is there, on the training scenes of a detector."""
    from ..training.presence import fit_detector

    _of_detector(detector, data, output, fit_detector)


def cut(detector: DetectorArgument, data: DataOption = None, output: TextOption = None) -> None:
    """Choose the scores below which detections are better not tracked, on the training scenes of a detector."""
    from ..training.detection_cuts import fit_detector

    _of_detector(detector, data, output, fit_detector)


def _of_detector(detector: str, data: str | None, output: Path | None, fit: Callable[[str, RunOptions], str]) -> None:
    from ..running.options import RunOptions
    from ..training.presence_recipes import DETECTORS, scenes_of

    require_writable(output)
    one_of(detector, DETECTORS, "DETECTOR")
    options = RunOptions(data)
    for scenes in scenes_of(detector):
        prepare(scenes.env, scenes.options(options))
    with working("read", options) as watched:
        text = fit(detector, watched)
    print_or_write(output, text)


train = typer.Typer(help="Fit the parameters of a baseline on training splits.", no_args_is_help=True)
train.command("motion-noise")(opened(motion_noise))
train.command("imm-noise")(opened(imm_noise))
train.command("presence")(opened(presence))
train.command("cut")(opened(cut))
