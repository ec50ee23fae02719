"""``mtp-bench compare``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Exit, Option

from ..cards import Card
from ..running import (
    EnvEvaluation,
    RunOptions,
    compare as run_comparison,
    compare_driving,
    compare_files,
    is_run,
)
from ..viz import counted, show_lines, show_table
from .options import (
    SEEDS,
    AgentScenes,
    JsonOption,
    SeedsOption,
    WorkerChoice,
)
from .output import STANDARD_OUTPUT, prepare, say, write_json, write_table
from .shown import Shown, show_differences, show_report


def compare(
    agents: Annotated[
        list[str],
        Argument(
            help="Names of baselines, folders of submissions or of stored runs.",
        ),
    ],
    on: AgentScenes,
    workers: WorkerChoice,
    shown: Shown,
    seeds: SeedsOption = SEEDS,
    json_file: JsonOption = None,
    no_times: Annotated[
        bool,
        Option(
            "--no-times", help="Leave times out of --json: equal runs, equal bytes."
        ),
    ] = False,
    train: Annotated[
        bool,
        Option("--train", help="First train the networks that have no weights here."),
    ] = False,
) -> None:
    """Run agents, ground-truth tracks and the controls on the same scenes.

    Prints one table and the verdict.
    """
    choices = _choices(on, workers, range(seeds))
    options = next(iter(choices.values()))
    env = on.card
    playing = [agent for agent in agents if not is_run(agent)]
    doubts = prepare(env, options, playing, on.no_doctor)
    if train:
        from .train import train_missing

        train_missing(playing, env if isinstance(env, str) else env.id, options)
    if options.card(env).drive is not None:
        _compare_driving(agents, env, options, shown, json_file)
        return
    if len(choices) > 1:
        result = compare_files(agents, env, choices)
    else:
        full = shown.is_full or json_file is not None
        result = run_comparison(agents, env, options, full)
    content = result.report.to_json("condition", "paired", "details", "failures")
    if no_times:
        del content["ms_per_frame"]
    doubt_texts = [f"{doubt.scene}: {doubt.line}" for doubt in doubts]
    write_json(json_file, content | {"skipped": result.skipped, "doubts": doubt_texts})
    names = result.names(agents)
    show_report(result.report, counted(seeds, "seed"), result.skipped, shown, names)
    if len(choices) > 1:
        show_differences(result.report, shown)
    if result.report.failures:
        raise Exit(1)


def _choices(
    on: AgentScenes, workers: WorkerChoice, seeds: Sequence[int]
) -> dict[str, RunOptions]:
    """Return the options with each of several files, by the path of the file.

    Raises BadParameter for several of both kinds.
    """
    files = {"tracks": on.tracks or [], "detections": on.detections or []}
    varied = max(files, key=lambda name: len(files[name]))
    paths = files[varied]
    if len(paths) < 2:
        return {"": on.options(workers, seeds)}
    choices = {}
    for path in paths:
        changes: dict[str, Any] = {varied: [path]}
        name = str(path).replace(" ", "_")  # behind a blank are parameters
        choices[name] = replace(on, **changes).options(workers, seeds)
    return choices


def _compare_driving(
    agents: list[str],
    env: str | Card,
    options: RunOptions,
    shown: Shown,
    json_file: Path | None,
) -> None:
    with EnvEvaluation.opened("driving", env, options, keywords={}) as evaluation:
        result = compare_driving(agents, evaluation, shown.full)
    table = result.table
    write_json(
        json_file,
        {"env": result.env, "rows": table.records, "failures": result.failures},
    )
    if json_file != STANDARD_OUTPUT:
        show_table(table)
        show_lines([table.sentence])
    write_table(shown.table_file, [table], table)
    for agent_name, reason in result.failures.items():
        say(f"{agent_name}: {reason}")
    if result.failures:
        raise Exit(1)
