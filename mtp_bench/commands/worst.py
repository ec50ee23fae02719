"""``mtp-bench worst``."""

from typing import Annotated

import numpy as np
from typer import BadParameter, Option

from ..core import long_work
from ..running import open_run
from ..scoring import BELOW, FAULTS, PARTS, named_parts
from ..viz import (
    CAPTION_BELOW,
    UNSPLIT,
    WORST_CAPTION,
    Listed,
    WorstRow,
    costs,
    counted,
    moments,
    replays,
    run_line,
    show,
    show_collisions,
    show_command,
    show_lines,
    show_table,
    worst_json,
    worst_table,
)
from .options import (
    DataOption,
    FolderArgument,
    JsonOption,
    RunCardOption,
    choice,
    one_of,
)
from .output import write_json

CAUSES = tuple(dict.fromkeys([*FAULTS, *PARTS.values()]))
LOOK = (
    "To look at the first; with --png FILE.png it becomes a picture, without a screen:"
)


def worst(
    folder: FolderArgument,
    scene: Annotated[str | None, Option(help="Only this scene.")] = None,
    cause: Annotated[
        str | None,
        choice(
            CAUSES,
            text=f"Only moments of this cause or part of the stack: {', '.join(CAUSES)}.",
        ),
    ] = None,
    class_name: Annotated[
        str | None, Option("--class", help="Only objects of this class.")
    ] = None,
    within: Annotated[
        float | None,
        Option(min=0, help="Only objects at most so many metres from the ego."),
    ] = None,
    top: Annotated[int, Option(min=1, help="How many.")] = 20,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """List the worst moments of a run: whose fault each was, and how to look at it."""
    hits = list[Listed]()
    below, whole, targets, rows, unsplit = (
        cause in (BELOW, "confidence"),
        np.zeros(len(PARTS)),
        0,
        list[WorstRow](),
        "",
    )
    with long_work("finding the worst moments") as progress:
        opened = open_run(folder, root, env)
        if class_name is not None:
            one_of(class_name, opened.card.task.classes, "--class")
        if within is not None and not opened.card.has_ego:
            raise BadParameter(
                f"{opened.card.id} has no ego to measure from", param_hint="--within"
            )
        for played in replays(opened, scene, progress):
            whole, unsplit = whole + np.nansum(played.part, axis=0), played.unsplit
            targets += int(np.isfinite(played.part[:, 0]).sum())
            hits += [
                Listed.of(played, e, str(folder), root, env)
                for e in played.incidents
                if e.kind == "collision"
            ]
            rows += [
                WorstRow.of(played, one.at, str(folder), root, env, moment=one)
                for one in moments(played, below)
            ]
    kept = [
        row
        for row in rows
        if (cause is None or below or cause in (row.moment.cause, row.fault))
        and (class_name is None or row.class_name == class_name)
        and (within is None or (row.moment.distance or 0.0) <= within)
    ]
    shown = sorted(kept, key=lambda row: -row.moment.cost)[:top]
    parts, total = named_parts(whole / max(1, targets)), float(costs(whole, below))
    write_json(
        json_file,
        worst_json(shown, total, parts, opened.card.id, opened.run.info.agent),
    )
    if shown:
        show_table(worst_table(shown, total))
        show("")
        show_lines([CAPTION_BELOW if below else WORST_CAPTION, LOOK])
        show_command(shown[0].view)
    show_collisions(hits, opened.rollouts(scene))
    share = sum(row.moment.cost for row in shown) / total if total else 0.0
    of_run = f"{len(shown)} of {counted(len(rows), 'moment')}, {share:.0%} of the {'part' if below else 'blame'}."
    show_lines(
        [
            *([UNSPLIT.format(unsplit)] if unsplit else []),
            of_run,
            run_line(parts, len(opened.rollouts(scene))),
        ]
    )
