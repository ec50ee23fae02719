"""``mtp-bench score``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..running.options import RunOptions
from ..running.stored import score as score_run
from ..scoring.rows import PER_SCENE
from ..tables import Table
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
        file_option("--per-scene", suffixes=(".csv", ".json"), text="Write a row per scene to this file."),
    ] = None,
) -> None:
    """Score stored rollouts."""
    with working(f"scoring {folder}", RunOptions(root)) as options:
        scored = score_run(folder, options, env)
    report = scored.report
    write_json(json_file, {**report.to_json("condition", "details"), "skipped": scored.skipped})
    scenes = Table("scenes", f"Scenes of {folder.name}", "", report.per_scene(), PER_SCENE)
    write_table(per_scene, [], scenes)
    show_report(report, folder.name, scored.skipped, shown)
