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
from .options import (
    DataOption,
    FolderArgument,
    JsonOption,
    NoDoctorOption,
    choice,
)
from .output import write_json

_KIND = choice(
    INCIDENT_KINDS,
    text="Only this kind, such as spurious (false forecasts); repeatable.",
)
_SORT = choice(
    ORDERS,
    text="time: by scene and frame; cost: the largest first.",
)


def events(
    folder: FolderArgument,
    scene: Annotated[str | None, Option(help="Only this scene.")] = None,
    kind: Annotated[list[str] | None, _KIND] = None,
    sort: Annotated[str, _SORT] = "time",
    top: Annotated[int | None, Option(min=1, help="Only the first N.")] = None,
    root: DataOption = None,
    no_doctor: NoDoctorOption = False,
    json_file: JsonOption = None,
) -> None:
    """List identity switches, losses, re-acquisitions, false forecasts and collisions.

    Each has a command that shows it.
    """
    all_rows = list[Listed]()
    with long_work("finding events") as progress:
        opened = open_run(folder, root)
        tally = Tally(any(len(rollout.track_id) for rollout in opened.rollouts()))
        for played in replays(opened, scene, progress, no_doctor):
            tally.add(played)
            for incident in played.incidents:
                all_rows.append(Listed.of(played, incident, str(folder), root))
    rows = [row for row in all_rows if kind is None or row.incident.kind in kind]
    rows = in_order(rows, sort)[:top]
    content = events_json(rows, tally, opened.card.id, opened.run.info.agent)
    write_json(json_file, content)
    listed = rows if kind or top else longest_only(rows)
    shown_command = ""
    if listed:
        shown_command = listed[0].view
        show_table(event_table(listed))
        show("")
        show_lines([EVENT_CAPTION, LOOK])
        show_command(shown_command)
    show_collisions(all_rows, shown_command)
    show(tally_line(tally, all_listed=len(listed) == len(rows)))
