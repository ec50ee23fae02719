"""``mtp-bench video``."""

from pathlib import Path
from typing import Annotated

from typer import Option

from ..core import long_work
from ..running import open_run
from ..traffic import RATE
from ..viz import (
    AT,
    VIDEO_SUFFIXES,
    PlayedRun,
    find_incident,
    frames_around,
    pictures,
    replay,
    require_encoder,
    show,
    write_video,
)
from .options import DataOption, FolderArgument, file_option
from .output import say

_OUTPUT = file_option(
    "-o",
    "--output",
    text="File to write: .gif, or .mp4, which needs `pip install av`.",
    suffixes=VIDEO_SUFFIXES,
)
_SCENE = Option(help="Which scene. Default: the first of the run.")
_AT = Option(help=f"Only from 3 s before to 3 s after this moment: {AT}.")
_FPS = Option(
    min=0.1, max=50, help="Pictures per second. Default: as many as were recorded."
)


def video(
    folder: FolderArgument,
    output: Annotated[Path, _OUTPUT],
    scene: Annotated[str | None, _SCENE] = None,
    at: Annotated[str | None, _AT] = None,
    fps: Annotated[float | None, _FPS] = None,
    root: DataOption = None,
) -> None:
    """Write a scene of a stored rollout as a video, seen from above."""
    require_encoder(output.suffix.lower())
    with long_work("drawing the video") as progress:
        opened = open_run(folder, root)
        rollout = opened.first(scene)
        content = opened.drawn(rollout.scene, say)
        rate_hz = opened.card.task.rate
        if at is None:
            played = replay(content, rollout, opened.card, opened.run.info.agent)
            incident = None
            frames = range(played.frames)
            if rollout.drive is not None:  # its states, and a second for the last one
                frames = range(len(rollout.drive.station) + round(RATE))
                rate_hz = RATE
        else:
            played = PlayedRun(opened).replay(rollout, content)
            incident = find_incident(played, at)
            frames = frames_around(played.scene, incident.frame)
        progress.started(len(frames))
        rate_hz = fps or rate_hz
        images = pictures(played, frames, incident)
        write_video(output, images, rate_hz, lambda: progress.done(rollout.scene))
    show(
        f"{output}: scene {rollout.scene}, frames {frames.start} to {frames.stop - 1}, "
        f"{rate_hz:g} per second"
    )
