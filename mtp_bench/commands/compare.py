"""``mtp-bench compare``."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import EnvScenes, JsonOption, WorkerChoice
from .output import count, prepare, require_writable, show_report, working, write_json


def compare(
    agents: Annotated[list[str], typer.Argument(help="Names of baselines or folders of submissions.")],
    on: EnvScenes,
    workers: WorkerChoice,
    seeds: Annotated[int, typer.Option(min=1, help="Runs with different random draws.")] = 3,
    reference: Annotated[
        str | None, typer.Option(help="Take the subsets from this agent's events, not the frozen ones.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Run agents side by side, with true pasts and the controls beside them, and print the comparison."""
    from ..running.compare import compare as run_comparison
    from ..viz.terminal.findings import findings
    from ..viz.terminal.output import show

    require_writable(json_file)
    options = on.options(workers, range(seeds))
    prepare(on.env, options)
    with working("compare", options) as watched:
        result = run_comparison(agents, on.env, watched, reference)
    report = result.report
    content = report.to_json("condition", "ranks", "paired", "details")
    write_json(json_file, {**content, "skipped": result.skipped})
    what = f"missing-aware error (m), {count(seeds, 'seed')} of sampling"
    show_report(report, what, result.reference.origin, result.skipped)
    for sentence in findings(report):
        show(f"• {sentence}")
