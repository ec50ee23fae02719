"""``mtp-bench train``."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import EnvScenes, JobsOption, TextOption, WorkerChoice, one_of
from .output import prepare, print_or_write, require_writable, working

KINDS = ("motion-noise", "operating-point")


def train(
    what: Annotated[str, typer.Argument(help="What to fit: motion-noise or operating-point.")],
    on: EnvScenes,
    observe: Annotated[str, typer.Option(help="detections or truth: what the pasts are made of.")] = "detections",
    jobs: JobsOption = 0,
    output: TextOption = None,
) -> None:
    """Fit the parameters of a baseline on the training split of an environment (or another)."""
    from ..training import motion_noise, operating_point

    require_writable(output)
    one_of(what, KINDS, "WHAT")
    if what == "operating-point" and observe != "detections":
        raise typer.BadParameter("true boxes have no scores to choose by", param_hint="--observe")
    options = on.options(WorkerChoice(jobs)).on_split("train")
    prepare(on.env, options)
    with working("read", options) as watched:
        if what == "operating-point":
            text = operating_point.fit_env(on.env, watched)
        else:
            text = motion_noise.fit_env(on.env, watched, observe)
    print_or_write(output, text)
