"""``mtp-bench worst``."""

from collections.abc import Sequence
from typing import Annotated

from typer import BadParameter, Option

from ..core import long_work
from ..running import OpenedRun, doubt_lines, open_run
from ..scoring import BELOW_THRESHOLD, PARTS, STAGE_PARTS
from ..viz import (
    CAPTION_BELOW,
    UNSPLIT,
    WORST_CAPTION,
    WorstRow,
    counted,
    run_line,
    show,
    show_collisions,
    show_command,
    show_lines,
    show_table,
    worst_json,
    worst_moments,
    worst_table,
)
from .options import (
    DataOption,
    FolderArgument,
    JsonOption,
    NoDoctorOption,
    choice,
    one_of,
)
from .output import write_json

CAUSES = tuple(dict.fromkeys([*STAGE_PARTS, *PARTS]))
LOOK = (
    "To look at the first; with --png FILE.png it becomes a picture, without a screen:"
)
_CAUSE = choice(
    CAUSES,
    text=f"Only moments of this cause or part of the stack: {', '.join(CAUSES)}.",
)
_CLASS = Option("--class", help="Only objects of this class.")
_WITHIN = Option(min=0, help="Only objects at most so many metres from the ego.")


def worst(
    folder: FolderArgument,
    scene: Annotated[str | None, Option(help="Only this scene.")] = None,
    cause: Annotated[str | None, _CAUSE] = None,
    class_name: Annotated[str | None, _CLASS] = None,
    within: Annotated[float | None, _WITHIN] = None,
    top: Annotated[int, Option(min=1, help="How many.")] = 20,
    root: DataOption = None,
    no_doctor: NoDoctorOption = False,
    json_file: JsonOption = None,
) -> None:
    """List the worst moments of a run: whose fault each was, and how to look at it."""
    is_below = cause in (BELOW_THRESHOLD, "confidence")
    with long_work("finding the worst moments") as progress:
        opened = open_run(folder, root)
        _check_filters(opened, class_name, within)
        worst_of_run = worst_moments(
            opened,
            scene,
            is_below=is_below,
            no_doctor=no_doctor,
            progress=progress,
        )
    rows = worst_of_run.rows
    total = worst_of_run.cost
    parts = worst_of_run.parts
    chosen = _chosen(rows, None if is_below else cause, class_name, within)[:top]
    content = worst_json(chosen, total, parts, opened.card.id, opened.run.info.agent)
    write_json(json_file, content)
    _show_moments(chosen, total, is_below)
    show_collisions(worst_of_run.collisions)
    if worst_of_run.unsplit:
        show_lines([UNSPLIT.format(worst_of_run.unsplit)])
    cost = sum(row.moment.cost for row in chosen)
    count = f"{len(chosen)} of {counted(len(rows), 'moment')}"
    sum_name = "part" if is_below else "blame"
    summary = f"{count}, {cost / (total or 1.0):.0%} of the {sum_name}."
    show_lines([summary, run_line(parts, len(opened.rollouts(scene)))])
    show_lines(doubt_lines(worst_of_run.doubts))


def _chosen(
    rows: Sequence[WorstRow],
    cause: str | None,
    class_name: str | None,
    within: float | None,
) -> list[WorstRow]:
    """Return the rows that pass the filters."""
    chosen = list(rows)
    if cause is not None:
        chosen = [row for row in chosen if cause in (row.moment.cause, row.fault)]
    if class_name is not None:
        chosen = [row for row in chosen if row.class_name == class_name]
    if within is not None:
        chosen = [row for row in chosen if (row.moment.distance or 0.0) <= within]
    return chosen


def _show_moments(rows: Sequence[WorstRow], total: float, is_below: bool) -> None:
    """Print the table of moments, and the command that shows the first."""
    if rows:
        show_table(worst_table(rows, total))
        show("")
        show_lines([CAPTION_BELOW if is_below else WORST_CAPTION, LOOK])
        show_command(rows[0].view)


def _check_filters(
    opened: OpenedRun, class_name: str | None, within: float | None
) -> None:
    """Refuse an unknown class, and a distance without an ego."""
    if class_name is not None:
        one_of(class_name, opened.card.task.classes, "--class")
    if within is not None and not opened.card.has_ego:
        raise BadParameter(
            f"{opened.card.id} has no ego to measure from", param_hint="--within"
        )
