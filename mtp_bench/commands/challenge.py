"""``mtp-bench challenge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..errors import DataError
from ..running.challenge import ChallengeScore, require_challenge, score_predictions
from ..running.options import RunOptions
from ..viz.terminal.output import counted, new_table, number, show, show_numbers
from .options import DataOption, JsonOption, ScenesOption, SplitOption
from .output import prepare, require_writable, working, write_json

MEANING = (
    "mean over the targets in the file, as in the devkit. Numbers from ground-truth tracks are not comparable with "
    "errors of `mtp-bench score`. OffRoadRate needs the map and is left out"
)


def challenge(
    file: Annotated[Path, typer.Argument(help="Submission to the nuScenes prediction challenge (.json).")],
    env: Annotated[str, typer.Option(help="Environment whose targets count.")] = "MTP-nuScenes-v0",
    root: DataOption = None,
    split: SplitOption = None,
    scenes: ScenesOption = None,
    json_file: JsonOption = None,
) -> None:
    """Score a submission to the nuScenes prediction challenge by the challenge's own metrics."""
    require_writable(json_file)
    if not file.is_file():
        raise DataError(f"no file {file}, expected a submission to the prediction challenge")
    options = RunOptions(root, scenes, split=split)
    require_challenge(options.card(env))
    prepare(env, options)
    with working("challenge", options) as watched:
        score = score_predictions(file, env, watched)
    write_json(json_file, score.to_json())
    show_numbers(_table(score))
    missing = score.targets - score.predicted
    show(
        f"{score.predicted} of {counted(score.targets, 'target')} predicted, {missing} missing; "
        f"{counted(score.elsewhere, 'prediction')} of other objects"
    )
    show(MEANING)


def _table(score: ChallengeScore) -> Table:
    table = new_table("nuScenes prediction challenge", ("metric", *(f"k = {k}" for k in score.ks)), left=("metric",))
    for name, values in score.metrics.items():
        table.add_row(name, *(number(value) for value in values))
    return table
