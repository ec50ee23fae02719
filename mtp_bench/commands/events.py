"""``mtp-bench events``."""

from typing import Annotated

from typer import Option

from ..core import long_work
from ..running import open_run
from ..viz import (
    EVENT_CAPTION,
    INCIDENT_KINDS,
    LOOK,
    ORDERS,
    Listed,
    Tally,
    event_table,
    events_json,
    in_order,
    longest_only,
    replays,
    show,
    show_collisions,
    show_command,
    show_lines,
    show_table,
    tally_line,
)
from .options import DataOption, FolderArgument, JsonOption, RunCardOption, choice
from .output import write_json


def events(
    folder: FolderArgument,
    scene: Annotated[str | None, Option(help="Only this scene.")] = None,
    kind: Annotated[
        list[str] | None,
        choice(
            INCIDENT_KINDS,
            text="Only this kind, such as spurious (false forecasts); repeatable.",
        ),
    ] = None,
    sort: Annotated[
        str,
        choice(
            ORDERS,
            text="time: by scene and frame; cost, confidence or length: the largest first.",
        ),
    ] = "time",
    top: Annotated[int | None, Option(min=1, help="Only the first N.")] = None,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """List identity switches, losses, re-acquisitions, false forecasts and collisions, and how to look at each."""
    tally, rows = Tally(), list[Listed]()
    with long_work("finding events") as progress:
        opened = open_run(folder, root, env)
        for played in replays(opened, scene, progress):
            tally.add(played)
            rows += [
                Listed.of(played, each, str(folder), root, env)
                for each in played.incidents
            ]
    hits = [row for row in rows if row.cause]
    rows = in_order(
        [row for row in rows if row.incident.kind in (kind or INCIDENT_KINDS)], sort
    )[:top]
    write_json(
        json_file, events_json(rows, tally, opened.card.id, opened.run.info.agent)
    )
    listed = rows if kind or top else longest_only(rows)
    if listed:
        show_table(event_table(listed))
        show("")
        show_lines([EVENT_CAPTION, LOOK])
        show_command(listed[0].view)
    show_collisions(hits, opened.rollouts(scene), listed[0].view if listed else "")
    show(tally_line(tally, all_listed=len(listed) == len(rows)))
