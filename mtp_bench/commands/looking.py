"""Commands that show stored rollouts: in rerun, as a list of events, as a video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import DataOption, FolderArgument, JsonOption, RunCardOption, require_writable, write_json


def view(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders written by `mtp-bench run`; several are shown side by side.")
    ],
    scene: Annotated[str | None, typer.Option("--scene", help="Which scene; the first of the run.")] = None,
    at: Annotated[str | None, typer.Option("--at", help="Open at this event; `mtp-bench events` lists them.")] = None,
    level: Annotated[
        str,
        typer.Option("--level", help="off, tracks, top (3 samples per object) or all (every sample and hypothesis)."),
    ] = "top",
    save: Annotated[Path | None, typer.Option("--save", help="Write a recording (.rrd) instead.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine instead.")] = False,
    root: DataOption = None,
    env: Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")] = None,
) -> None:
    """Look at tracks, hypotheses, forecasts and events of stored rollouts in rerun."""
    from ..viz.rerun.arrays import LEVELS
    from ..viz.terminal.output import show
    from .viewing import view_runs

    if level not in LEVELS:
        raise typer.BadParameter(f"{level!r}, expected one of: {', '.join(LEVELS)}", param_hint="--level")
    if save is not None and web:
        raise typer.BadParameter("a recording is either written or served", param_hint="--save, --web")
    if save is not None and save.suffix != ".rrd":
        raise typer.BadParameter(f"{save}: the viewer opens files that end in .rrd", param_hint="--save")
    require_writable(save)
    view_runs(folders, scene, at, level, save, web, root, env, show)


def events(
    folder: FolderArgument,
    scene: Annotated[str | None, typer.Option("--scene", help="Only this scene.")] = None,
    kind: Annotated[
        list[str] | None, typer.Option("--kind", help="Only ids, lost, reacquired or spurious; repeatable.")
    ] = None,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """List identity switches, losses, re-acquisitions and forecasts of nothing, and how to look at each."""
    from ..running.opened import open_run
    from ..viz.replay import KINDS, replay
    from ..viz.terminal.event_table import (
        EventRow,
        Shown,
        Tally,
        event_rows,
        event_table,
        events_json,
        longest_only,
        tally_line,
    )
    from ..viz.terminal.output import progress_bar, show, show_numbers

    for name in kind or ():
        if name not in KINDS:
            raise typer.BadParameter(f"{name!r}, expected one of: {', '.join(KINDS)}", param_hint="--kind")
    require_writable(json_file)
    shown, tally = Shown(str(folder), root, env), Tally()
    rows: list[EventRow] = []
    with progress_bar("events") as (started, done):
        opened = open_run(folder, root, env)
        rollouts = opened.rollouts(scene)
        started(len(rollouts))
        for rollout in rollouts:
            played = replay(opened.scene(rollout.scene), rollout, opened.card, opened.run.info.agent)
            tally.add(played)
            rows += event_rows(played, kind or KINDS, shown)
            done(rollout.scene)
    write_json(json_file, events_json(rows, tally, opened.card.id, opened.run.info.agent))
    listed = rows if kind else longest_only(rows)
    if listed:
        show_numbers(event_table(listed))
    show(tally_line(tally, all_listed=len(listed) == len(rows)))


def video(
    folder: FolderArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .mp4 or .gif.")],
    scene: Annotated[str | None, typer.Option("--scene", help="Which scene; the first of the run.")] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="Only 2 s before and after this event; `mtp-bench events` lists them.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option("--fps", min=0.1, max=50, help="Pictures per second; as many as were recorded.")
    ] = None,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write a scene of a stored rollout as a video, seen from above."""
    from ..running.opened import open_run
    from ..viz.drawing.video import KINDS, frames_around, pictures, require_encoder, write_video
    from ..viz.replay import replay
    from ..viz.terminal.output import progress_bar, show

    suffix = output.suffix.lower()
    if suffix not in KINDS:
        raise typer.BadParameter(f"{output}: expected a name that ends in {' or '.join(KINDS)}", param_hint="--output")
    require_writable(output)
    require_encoder(suffix)
    with progress_bar("video") as (started, done):
        opened = open_run(folder, root, env)
        rollout = opened.first(scene)
        played = replay(opened.scene(rollout.scene), rollout, opened.card, opened.run.info.agent)
        frames = frames_around(played, at)
        started(len(frames))
        rate = fps or opened.card.task.rate
        write_video(output, pictures(played, frames, at), rate, lambda: done(rollout.scene))
    show(f"{output}: scene {rollout.scene}, frames {frames.start} to {frames.stop - 1}, {rate:g} per second")
