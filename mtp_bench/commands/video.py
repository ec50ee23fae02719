"""``mtp-bench video``."""

from pathlib import Path
from typing import Annotated

from typer import Option

from ..core import long_work
from ..running import open_run
from ..viz import (
    AT,
    VIDEO_SUFFIXES,
    PlayedRun,
    found,
    frames_around,
    pictures,
    replay,
    require_encoder,
    show,
    write_video,
)
from .options import DataOption, FolderArgument, RunCardOption, file_option
from .output import say


def video(
    folder: FolderArgument,
    output: Annotated[
        Path,
        file_option(
            "-o",
            "--output",
            text="File to write: .mp4 or .gif.",
            suffixes=VIDEO_SUFFIXES,
        ),
    ],
    scene: Annotated[
        str | None, Option(help="Which scene. Default: the first of the run.")
    ] = None,
    at: Annotated[
        str | None, Option(help=f"Only from 3 s before to 3 s after this moment: {AT}.")
    ] = None,
    fps: Annotated[
        float | None,
        Option(
            min=0.1,
            max=50,
            help="Pictures per second. Default: as many as were recorded.",
        ),
    ] = None,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write a scene of a stored rollout as a video, seen from above."""
    require_encoder(output.suffix.lower())
    with long_work("drawing the video") as progress:
        opened = open_run(folder, root, env)
        rollout = opened.first(scene)
        drawn = opened.drawn(rollout.scene, say)
        if at is None:
            played, incident = (
                replay(drawn, rollout, opened.card, opened.run.info.agent),
                None,
            )
        else:
            played = PlayedRun(opened).replay(rollout, drawn)
            incident = found(played, at)
        frames = (
            range(played.frames)
            if incident is None
            else frames_around(played.scene, incident.frame)
        )
        progress.started(len(frames))
        rate = fps or opened.card.task.rate
        write_video(
            output,
            pictures(played, frames, incident),
            rate,
            lambda: progress.done(rollout.scene),
        )
    show(
        f"{output}: scene {rollout.scene}, frames {frames.start} to {frames.stop - 1}, {rate:g} per second"
    )
