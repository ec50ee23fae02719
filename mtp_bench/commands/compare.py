"""``mtp-bench compare``."""

from typing import Annotated

from typer import Argument, Exit, Option

from ..running.compare import compare as run_comparison
from ..running.compare import control_names
from ..viz.terminal.output import counted
from .options import SEEDS, AgentScenes, JsonOption, SeedsOption, WorkerChoice, submissions
from .output import prepare, show_report, write_json
from .shown import Shown


def compare(
    agents: Annotated[
        list[str], Argument(help="Names of baselines or folders of submissions.", autocompletion=submissions)
    ],
    on: AgentScenes,
    workers: WorkerChoice,
    shown: Shown,
    seeds: SeedsOption = SEEDS,
    json_file: JsonOption = None,
    train: Annotated[bool, Option("--train", help="First train the networks that have no weights here.")] = False,
) -> None:
    """Run agents, ground-truth tracks and the controls on the same scenes; print one table and the verdict."""
    options = on.options(workers, range(seeds))
    prepare(on.env, options, agents)
    if train:
        from .train import train_missing

        train_missing(agents, on.env, options)
    if options.card(on.env).drive is not None:
        from .driving import compare_driving

        compare_driving(agents, on.env, options, shown, json_file)
        return
    result = run_comparison(agents, on.env, options, full=shown.is_full or json_file is not None)
    content = result.report.to_json("condition", "paired", "details", "failures")
    write_json(json_file, content | {"skipped": result.skipped})
    ran = dict.fromkeys(setting.submission.name for setting in result.settings)
    names = [name for name in ran if name in agents or name not in control_names()]
    show_report(result.report, counted(seeds, "seed"), result.skipped, shown, names)
    if result.report.failures:
        raise Exit(1)
