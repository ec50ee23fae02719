"""``mtp-bench robustness``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option

from ..running import LEVELS, robustness as run_robustness
from ..viz import FILE_SUFFIXES, draw_curves, show_lines, show_table
from .options import (
    AgentScenes,
    JsonOption,
    TableOption,
    WorkerChoice,
    choice,
    file_option,
)
from .output import STANDARD_OUTPUT, prepare, write_json, write_table


def robustness(
    agents: Annotated[
        list[str], Argument(help="Names of baselines or folders of submissions.")
    ],
    on: AgentScenes,
    workers: WorkerChoice,
    knob: Annotated[str, choice(tuple(LEVELS), text=f"One of {', '.join(LEVELS)}.")],
    levels: Annotated[
        str | None, Option(help="Such as 0,1,2,4. Default: those of the page.")
    ] = None,
    seeds: Annotated[int, Option(min=1, help="Runs with different draws.")] = 1,
    folder: Annotated[
        Path | None,
        Option("-o", "--output", help="Folder of finished levels, not run again."),
    ] = None,
    plot: Annotated[
        Path | None,
        file_option("--plot", text="Draw the curves.", suffixes=FILE_SUFFIXES),
    ] = None,
    table_file: TableOption = None,
    json_file: JsonOption = None,
) -> None:
    """Run agents at several strengths of one error of the detector.

    Which agent is best at which strength, and where do hypotheses gain?
    """
    options = on.options(workers, range(seeds))
    try:
        chosen = None if levels is None else [float(text) for text in levels.split(",")]
    except ValueError:
        message = f"{levels!r}, expected numbers such as 0,1,2,4"
        raise BadParameter(message, param_hint="--levels") from None
    prepare(on.card, options, agents, on.no_doctor)
    result = run_robustness(agents, on.card, knob, chosen, options, folder)
    write_json(json_file, result.to_json())
    write_table(table_file, result.tables, result.table())
    if plot is not None:
        draw_curves([result], plot)
    if json_file != STANDARD_OUTPUT:
        for table in result.tables:
            show_table(table)
            show_lines([table.sentence])
        ratios = result.mean_relative.items()
        means = ", ".join(f"{agent} {ratio:.2f}" for agent, ratio in ratios)
        show_lines([result.answer, f"Mean over levels, by stp: {means}."])
