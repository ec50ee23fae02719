"""``mtp-bench view``: runs of one scene in a window or a file."""

# rerun is slow to load: its functions are imported, and called, without --png alone
# pyright: reportPossiblyUnboundVariable=false

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option

from ..core import long_work
from ..running import OpenedRun, open_runs
from ..sources import camera_images
from ..viz import (
    AT,
    Focus,
    PlayedRun,
    Replay,
    find_incident,
    focuses_of,
    save_report,
    sentence,
    show,
)
from .options import DataOption, NoDoctorOption, file_option
from .output import say

_FOLDERS = Argument(
    help="Folders written by `mtp-bench run`; several are shown side by side."
)
_SCENE = Option(help="Which scene. Default: the first of the run.")
_AT = Option(help=f"Open the first run there: {AT}.")
_ALL = Option("--all", help="Every hypothesis and sample, not the heaviest alone.")
_SAVE = file_option(
    "--save", text="Write a recording (.rrd) instead.", suffixes=(".rrd",)
)
_PNG = file_option(
    "--png",
    text="Write a picture (.png) instead; needs --at, no screen, no rerun.",
    suffixes=(".png",),
)


def view(
    folders: Annotated[list[Path], _FOLDERS],
    scene: Annotated[str | None, _SCENE] = None,
    at: Annotated[str | None, _AT] = None,
    is_all: Annotated[bool, _ALL] = False,
    save: Annotated[Path | None, _SAVE] = None,
    png: Annotated[Path | None, _PNG] = None,
    root: DataOption = None,
    no_doctor: NoDoctorOption = False,
) -> None:
    """Look at tracks, hypotheses, forecasts and events of stored rollouts in rerun."""
    if save is not None and png is not None:
        raise BadParameter("choose one of them", param_hint="--save, --png")
    if png is not None and at is None:
        raise BadParameter(
            "a picture shows one moment: name it with --at; `mtp-bench worst` lists "
            "them",
            param_hint="--png",
        )
    runs = open_runs(folders, root)
    if png is None:
        with long_work("loading rerun"):
            from ..viz import (
                require_display,
                save_recording,
                show_recording,
            )

        if save is None:
            require_display()
    replays = _replays(runs, scene, at is not None, no_doctor)
    incident = None
    focuses: list[Focus] = []
    if at is not None:
        incident = find_incident(replays[0], at)
        focuses = focuses_of(replays, incident)
    text = _text(replays, focuses)
    if png is not None:
        save_report(png, *focuses)
        show(f"{png}: {text}")
    elif save is not None:
        save_recording(save, replays, is_all, incident)
        show(f"{save}: {text}; open it with `rerun {shlex.quote(str(save))}`")
    else:
        show_recording(replays, is_all, incident)
        show(text)


@long_work("reading the scene and finding its events")
def _replays(
    runs: Sequence[OpenedRun], scene: str | None, with_images: bool, no_doctor: bool
) -> list[Replay]:
    """Replay one scene of runs.

    By default it is the first of the first run. ``with_images``: they have the
    camera images of the source. Raises UnknownNameError for a run without the scene.
    """
    first = runs[0]
    name = first.first(scene).scene
    content = first.drawn(name, say)
    cameras = camera_images(content, first.card, first.data, say) if with_images else ()
    replays = []
    for run in runs:
        run_content = content
        if run is not first:  # its detections may be other draws
            run_content = replace(content, detections=run.scene(name).detections)
        played = PlayedRun(run, no_doctor).replay(run.first(name), run_content)
        replays.append(replace(played, images=cameras))
    return replays


def _text(replays: Sequence[Replay], focuses: Sequence[Focus]) -> str:
    """Return scene, event and its counterparts in words."""
    text = f"scene {replays[0].scene.name}"
    for focus in focuses[:1]:
        text += f", frame {focus.at.frame}, {sentence(focus)}"
    for focus in focuses[1:]:
        text += f"; {focus.replay.agent}: {sentence(focus)}"
    return text
