"""``mtp-bench compare``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Exit, Option

from ..cards import Card
from ..running import (
    EnvEvaluation,
    RunOptions,
    compare as run_comparison,
    compare_driving,
    control_names,
)
from ..viz import counted, show_lines, show_table
from .options import (
    SEEDS,
    AgentScenes,
    JsonOption,
    SeedsOption,
    WorkerChoice,
    submissions,
)
from .output import STANDARD_OUTPUT, prepare, say, show_report, write_json, write_table
from .shown import Shown


def compare(
    agents: Annotated[
        list[str],
        Argument(
            help="Names of baselines or folders of submissions.",
            autocompletion=submissions,
        ),
    ],
    on: AgentScenes,
    workers: WorkerChoice,
    shown: Shown,
    seeds: SeedsOption = SEEDS,
    json_file: JsonOption = None,
    train: Annotated[
        bool,
        Option("--train", help="First train the networks that have no weights here."),
    ] = False,
) -> None:
    """Run agents, ground-truth tracks and the controls on the same scenes; print one table and the verdict."""
    options, env = on.options(workers, range(seeds)), on.card
    prepare(env, options, agents)
    if train:
        from .train import train_missing

        train_missing(agents, env if isinstance(env, str) else env.id, options)
    if options.card(env).drive is not None:
        _compare_driving(agents, env, options, shown, json_file)
        return
    result = run_comparison(
        agents, env, options, full=shown.is_full or json_file is not None
    )
    content = result.report.to_json("condition", "paired", "details", "failures")
    write_json(json_file, content | {"skipped": result.skipped})
    ran = dict.fromkeys(setting.submission.name for setting in result.settings)
    names = [name for name in ran if name in agents or name not in control_names()]
    show_report(result.report, counted(seeds, "seed"), result.skipped, shown, names)
    if result.report.failures:
        raise Exit(1)


def _compare_driving(
    agents: list[str],
    env: str | Card,
    options: RunOptions,
    shown: Shown,
    file: Path | None,
) -> None:
    if shown.columns or shown.subsets:
        options.card(env).require_same_scenes(
            "which has one table of driving", "leave --columns and --subsets out"
        )
    with EnvEvaluation.opened("driving", env, options, {}) as evaluation:
        result = compare_driving(agents, evaluation, shown.full)
    write_json(
        file,
        {"env": result.env, "rows": result.table.records, "failures": result.failures},
    )
    if file != STANDARD_OUTPUT:
        show_table(result.table)
        show_lines([result.table.sentence])
    write_table(shown.table_file, [result.table], result.table)
    for name, reason in result.failures.items():
        say(f"{name}: {reason}")
    if result.failures:
        raise Exit(1)
