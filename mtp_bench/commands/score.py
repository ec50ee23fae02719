"""``mtp-bench score``."""

from pathlib import Path
from typing import Annotated

from ..core import Column, Table, columns_of
from ..running import RunOptions, score as score_run
from ..scoring import Row
from .options import DataOption, FolderArgument, JsonOption, RunCardOption, file_option
from .output import show_report, working, write_json, write_table
from .shown import Shown


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
    with working(f"scoring {folder}", RunOptions(root)) as options:
        scored = score_run(folder, options, env)
    report = scored.report
    write_json(
        json_file, {**report.to_json("condition", "details"), "skipped": scored.skipped}
    )
    scenes, known = (
        report.per_scene(),
        {column.key: column for column in columns_of(Row)},
    )
    columns = [
        known.get(key, Column(key=key))
        for key in dict.fromkeys(key for row in scenes for key in row)
    ]
    write_table(
        per_scene, [], Table("scenes", f"Scenes of {folder.name}", "", scenes, columns)
    )
    show_report(report, folder.name, scored.skipped, shown)
