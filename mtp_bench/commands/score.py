"""``mtp-bench score``."""

from pathlib import Path
from typing import Annotated

from ..core import Column, Table, columns_of
from ..running import RunOptions, score as score_run
from ..scoring import Report, Row
from .options import DataOption, FolderArgument, JsonOption, RunCardOption, file_option
from .output import write_json, write_table
from .shown import Shown, show_report


def score(
    folder: FolderArgument,
    shown: Shown,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
    per_scene: Annotated[
        Path | None,
        file_option(
            "--per-scene",
            suffixes=(".csv", ".json"),
            text="Write a row per scene to this file.",
        ),
    ] = None,
) -> None:
    """Score stored rollouts."""
    scored = score_run(folder, RunOptions(root), env)
    report = scored.report
    content = report.to_json("condition", "details")
    write_json(json_file, {**content, "skipped": scored.skipped})
    write_table(per_scene, [], _scene_table(report, f"Scenes of {folder.name}"))
    show_report(report, folder.name, scored.skipped, shown)


def _scene_table(report: Report, title: str) -> Table:
    """Return a row per scene, with the columns of a report's row where they fit."""
    rows = report.per_scene()
    row_columns = {column.key: column for column in columns_of(Row)}
    keys = dict.fromkeys(key for row in rows for key in row)
    columns = [row_columns.get(key, Column(key=key)) for key in keys]
    return Table("scenes", title, "", rows, columns)
