"""Output of ``mtp-bench compare`` on a closed loop."""

from collections.abc import Sequence
from pathlib import Path

import typer

from ..running.compare import EnvEvaluation
from ..running.drives import compare_driving as run_comparison
from ..running.options import RunOptions
from ..tables import to_text
from .output import STANDARD_OUTPUT, say, write_json, write_table
from .shown import Shown


def compare_driving(agents: Sequence[str], env: str, options: RunOptions, shown: Shown, json_file: Path | None) -> None:
    """Let agents drive in the scenes of ``env`` and print one table."""
    if shown.columns or shown.subsets:
        options.card(env).require_same_scenes("which has one table of driving", "leave --columns and --subsets out")
    with EnvEvaluation.opened("driving", env, options, {}) as evaluation:
        result = run_comparison(agents, evaluation, shown.full)
    write_json(json_file, {"env": result.env, "rows": result.table.records, "failures": result.failures})
    if json_file != STANDARD_OUTPUT:
        print(to_text(result.table))
    write_table(shown.table_file, [result.table], result.table)
    for name, reason in result.failures.items():
        say(f"{name}: {reason}")
    if result.failures:
        raise typer.Exit(1)
