"""``mtp-bench score``."""

from __future__ import annotations

from ..running.options import RunOptions
from ..running.stored import score as score_run
from .options import DataOption, FolderArgument, JsonOption, RunCardOption
from .output import show_report, working, write_json
from .shown import Shown


def score(
    folder: FolderArgument,
    shown: Shown,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    with working(f"scoring {folder}", RunOptions(root)) as options:
        scored = score_run(folder, options, env)
    report = scored.report
    write_json(json_file, {**report.to_json("condition", "details"), "skipped": scored.skipped})
    show_report(report, folder.name, scored.skipped, shown)
