"""``mtp-bench view``: runs of one scene as a recording, in a file, a window or a browser."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import MtpBenchError
from .completion import words
from .options import DataOption, RunCardOption, one_of
from .output import require_writable, say

if TYPE_CHECKING:
    from ..running.rollout_files import RunInfo
    from ..running.stored import OpenedRun
    from ..viz.replay import Incident, Replay


def view(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders written by `mtp-bench run`; several are shown side by side.")
    ],
    scene: Annotated[str | None, typer.Option(help="Which scene. Default: the first of the run.")] = None,
    at: Annotated[
        str | None, typer.Option(help="Open at this event of the first run; `mtp-bench events` lists them.")
    ] = None,
    level: Annotated[
        str,
        typer.Option(
            help="off, tracks, top (3 samples per object) or all (every sample and hypothesis).",
            autocompletion=words("off", "tracks", "top", "all"),
        ),
    ] = "top",
    save: Annotated[Path | None, typer.Option(help="Write a recording (.rrd) instead.")] = None,
    png: Annotated[
        Path | None, typer.Option(help="Write a picture of the event (.png) instead; needs --at, no screen, no rerun.")
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine instead.")] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Look at tracks, hypotheses, forecasts and events of stored rollouts in rerun."""
    from ..viz.rerun.contents import LEVELS
    from ..viz.terminal.output import show

    one_of(level, LEVELS, "--level")
    if (save is not None) + web + (png is not None) > 1:
        raise typer.BadParameter("choose one of them", param_hint="--save, --web, --png")
    if save is not None and save.suffix != ".rrd":
        raise typer.BadParameter(f"{save}: the viewer opens files that end in .rrd", param_hint="--save")
    require_writable(save, png)
    if png is not None:
        _write_picture(png, at, folders, scene, root, env)
        return
    from ..viz.rerun.log import save_recording
    from ..viz.rerun.viewer import require_display, serve_recording, show_recording

    runs = _opened(folders, root, env)
    if save is None and not web:
        require_display()
    replays = _replays(runs, scene, at is not None)
    incident = None if at is None else replays[0].incident(at)
    what = _sentence(replays, incident)
    if save is not None:
        save_recording(save, replays, level, incident)
        show(f"{save}: {what}; open it with `rerun {shlex.quote(str(save))}`")
    elif web:
        serve_recording(replays, level, incident, lambda url: show(f"{what}: {url} until Ctrl-C"))
    else:
        show_recording(replays, level, incident)
        show(what)


def _write_picture(
    png: Path, at: str | None, folders: Sequence[Path], scene: str | None, data: str | None, env_id: str | None
) -> None:
    """Write the picture of an event, and below it of what the other runs do there."""
    from ..viz.drawing.report import save_report
    from ..viz.focus import Focus
    from ..viz.terminal.output import show

    if png.suffix.lower() != ".png":
        raise typer.BadParameter(f"{png}: expected a name that ends in .png", param_hint="--png")
    if at is None:
        raise typer.BadParameter(
            "a picture shows one event: name it with --at; `mtp-bench events` lists them", param_hint="--png"
        )
    replays = _replays(_opened(folders, data, env_id), scene, True)
    incident = replays[0].incident(at)
    save_report(png, *Focus.of_all(replays, incident))
    show(f"{png}: {_sentence(replays, incident)}")


def _opened(folders: Sequence[Path], data: str | None, env_id: str | None) -> list[OpenedRun]:
    """The runs in ``folders``; raises MtpBenchError where they were made for different cards."""
    from ..running.stored import open_run

    runs = [open_run(folder, data, env_id) for folder in folders]
    first = runs[0]
    for run in runs[1:]:
        if run.card.digest != first.card.digest:
            raise MtpBenchError(
                f"{run.folder}: made for {run.card.id} ({run.card.digest}), expected {first.card.id} "
                f"({first.card.digest}) as in {first.folder}: only runs of one env and detector share a picture"
            )
    return runs


def _replays(runs: Sequence[OpenedRun], scene: str | None, images: bool) -> list[Replay]:
    """The runs of one scene, by default the first of the first run; with the camera ``images`` where they are there.

    Raises UnknownNameError where one of them has no such scene.
    """
    from ..viz.replay import replay

    first = runs[0]
    name = first.first(scene).scene
    content = first.drawn(name, say)
    found = first.images(content, say) if images else ()
    replays = []
    for run, agent in zip(runs, _names([run.run.info for run in runs]), strict=True):
        given = content if run is first else replace(content, detections=run.scene(name).detections)
        played = replay(given, run.first(name), run.card, agent)
        replays.append(replace(played, images=found, observe=run.run.info.observe))
    return replays


def _names(runs: Sequence[RunInfo]) -> list[str]:
    """Names of the runs; those of one agent say how many hypotheses they have, where these differ."""
    several = {run.agent for run in runs for other in runs if run.agent == other.agent and _held(run) != _held(other)}
    return [f"{run.agent} (H = {_held(run)})" if run.agent in several else run.agent for run in runs]


def _held(run: RunInfo) -> int:
    return run.hypotheses or 1


def _sentence(replays: Sequence[Replay], incident: Incident | None) -> str:
    """What is seen: the event of the first run, and what the others do there."""
    from ..viz.focus import Focus

    name = replays[0].scene.name
    if incident is None:
        return f"scene {name}"
    first, *others = Focus.of_all(replays, incident)
    said = [f"scene {name}, frame {incident.frame}, {first.sentence}"]
    return "; ".join([*said, *(f"{each.replay.agent}: {each.sentence}" for each in others)])
