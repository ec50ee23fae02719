"""Commands that fit parameters to data, and the one that freezes subsets."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .shared import (
    DataOption,
    DetectionsOption,
    DetectorOption,
    EnvOption,
    JobsOption,
    ScenesOption,
    SplitOption,
    given,
    prepare,
    require_writable,
    workers,
)


def train(
    what: Annotated[str, typer.Argument(help="What to fit: motion-noise or operating-point.")],
    env: EnvOption,
    root: DataOption = None,
    observe: Annotated[
        str, typer.Option("--observe", help="detections or truth: what the pasts are made of.")
    ] = "detections",
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")] = None,
) -> None:
    """Fit the parameters of a baseline on the training split of an environment (or another)."""
    from ..files import write_text
    from ..training.fit import KINDS, fit_motion_noise, fit_operating_point
    from ..viz.terminal.output import progress_bar

    require_writable(output)
    if what not in KINDS:
        raise typer.BadParameter(f"{what!r} cannot be fitted, expected one of: {', '.join(KINDS)}", param_hint="WHAT")
    if what == "operating-point" and observe != "detections":
        raise typer.BadParameter("true boxes have no scores to choose by", param_hint="--observe")
    changes = {"split": "train", **given(split=split, detector=detector, detection_file=detections)}
    prepare(env, root, scenes, jobs, changes)
    with progress_bar("read") as (started, done):
        if what == "operating-point":
            text = fit_operating_point(env, root, started, done, scenes, changes)
        else:
            text = fit_motion_noise(env, root, observe, started, done, scenes, changes)
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


def fit_noise(
    env: EnvOption,
    root: DataOption = None,
    scenes: ScenesOption = None,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    min_score: Annotated[
        list[str] | None, typer.Option("--min-score", help="Operating point: a number, or class=number; repeatable.")
    ] = None,
    alike: Annotated[
        list[str] | None,
        typer.Option("--alike", help="bus=car: its noise, where bus cannot be fitted; repeatable."),
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the profile; agents go by the part before its first hyphen.")
    ] = None,
    reach: Annotated[
        float | None, typer.Option("--reach", min=1, max=1000, help="How far the detector sees, metres.")
    ] = None,
    field_of_view: Annotated[
        float | None, typer.Option("--field-of-view", min=1, max=360, help="Degrees around the heading.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")] = None,
) -> None:
    """Fit the noise of a simulated detector to the detections of an environment, as a section of a card."""
    from ..files import write_text
    from ..training.noise_profile import fit_noise as fit
    from ..viz.terminal.output import progress_bar

    require_writable(output)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, 0, changes)
    with progress_bar("read") as (started, done):
        text = fit(env, root, scenes, changes, min_score or (), alike or (), name, reach, field_of_view, started, done)
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen subsets of a shipped environment (maintainers)."""
    from ..running.reference import freeze as write
    from ..viz.terminal.output import progress_bar, show

    prepare(env, root, None, jobs, {})
    with progress_bar("freeze") as (started, done):
        path, counts = write(env, root, workers(jobs), started, done)
    show(f"{path}: {counts}")
