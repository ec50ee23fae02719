"""``mtp-bench view``: runs of one scene as a recording, in a file, a window or a browser."""

# rerun is slow to load: its functions are imported, and called, without --png alone
# pyright: reportPossiblyUnboundVariable=false

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option

from ..core import MtpBenchError, long_work
from ..running import OpenedRun, open_run
from ..sources import camera_images
from ..viz import (
    AT,
    LEVELS,
    Focus,
    PlayedRun,
    Replay,
    focuses_of,
    found,
    save_report,
    sentence,
    show,
)
from .options import DataOption, RunCardOption, choice, file_option
from .output import say


def view(
    folders: Annotated[
        list[Path],
        Argument(
            help="Folders written by `mtp-bench run`; several are shown side by side."
        ),
    ],
    scene: Annotated[
        str | None, Option(help="Which scene. Default: the first of the run.")
    ] = None,
    at: Annotated[str | None, Option(help=f"Open the first run there: {AT}.")] = None,
    level: Annotated[
        str,
        choice(
            LEVELS,
            text="tracks, top (3 samples per object) or all (every sample and hypothesis).",
        ),
    ] = "top",
    save: Annotated[
        Path | None,
        file_option(
            "--save", text="Write a recording (.rrd) instead.", suffixes=(".rrd",)
        ),
    ] = None,
    png: Annotated[
        Path | None,
        file_option(
            "--png",
            text="Write a picture (.png) instead; needs --at, no screen, no rerun.",
            suffixes=(".png",),
        ),
    ] = None,
    web: Annotated[
        bool, Option("--web", help="Serve it to a browser on this machine instead.")
    ] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Look at tracks, hypotheses, forecasts and events of stored rollouts in rerun."""
    if (save is not None) + web + (png is not None) > 1:
        raise BadParameter("choose one of them", param_hint="--save, --web, --png")
    if png is not None and at is None:
        advice = "a picture shows one moment: name it with --at; `mtp-bench worst` lists them"
        raise BadParameter(advice, param_hint="--png")
    runs = _opened(folders, root, env)
    if png is None:
        with long_work("loading rerun"):
            from ..viz import (
                require_display,
                save_recording,
                serve_recording,
                show_recording,
            )

        if save is None and not web:
            require_display()
    replays = _replays(runs, scene, at is not None)
    incident = None if at is None else found(replays[0], at)
    focuses = [] if incident is None else focuses_of(replays, incident)
    shown = _sentence(replays, focuses)
    if png is not None:
        save_report(png, *focuses)
        show(f"{png}: {shown}")
    elif save is not None:
        save_recording(save, replays, level, incident)
        show(f"{save}: {shown}; open it with `rerun {shlex.quote(str(save))}`")
    elif web:
        with long_work(""):  # nothing to say while the user looks at it
            serve_recording(
                replays,
                level,
                incident,
                lambda url: show(f"{shown}: {url} until Ctrl-C"),
            )
    else:
        show_recording(replays, level, incident)
        show(shown)


def _opened(
    folders: Sequence[Path], data: str | None, env_id: str | None
) -> list[OpenedRun]:
    """The runs in ``folders``; raises MtpBenchError if they were made for different cards."""
    runs = [open_run(folder, data, env_id) for folder in folders]
    first = runs[0]
    for run in runs[1:]:
        if run.card.digest != first.card.digest:
            raise MtpBenchError(
                f"{run.folder}: made for {run.card.id} ({run.card.digest}), expected {first.card.id} "
                f"({first.card.digest}) as in {first.folder}: only runs of one env and detector share a picture"
            )
    return runs


@long_work("reading the scene and finding its events")
def _replays(
    runs: Sequence[OpenedRun], scene: str | None, images: bool
) -> list[Replay]:
    """The runs of one scene, by default the first of the first run, with the camera ``images`` that its source has.

    Runs of one agent with different numbers of hypotheses have these in their names. Raises UnknownNameError for a run
    without the scene.
    """
    first = runs[0]
    name = first.first(scene).scene
    content = first.drawn(name, say)
    cameras = camera_images(content, first.card, first.data, say) if images else ()
    counts: dict[str, set[int]] = {}
    for run in runs:
        counts.setdefault(run.run.info.agent, set()).add(run.run.info.hypotheses or 1)
    replays = []
    for run in runs:
        info = run.run.info
        given = (
            content
            if run is first
            else replace(content, detections=run.scene(name).detections)
        )
        agent = (
            info.agent
            if len(counts[info.agent]) == 1
            else f"{info.agent} (H = {info.hypotheses or 1})"
        )
        replays.append(
            replace(
                PlayedRun(run).replay(run.first(name), given, agent), images=cameras
            )
        )
    return replays


def _sentence(replays: Sequence[Replay], focuses: Sequence[Focus]) -> str:
    """The scene, the event of the first run, and its counterparts in the others."""
    name = replays[0].scene.name
    if not focuses:
        return f"scene {name}"
    first, *others = focuses
    sentences = [f"scene {name}, frame {first.at.frame}, {sentence(first)}"]
    return "; ".join(
        [*sentences, *(f"{each.replay.agent}: {sentence(each)}" for each in others)]
    )
