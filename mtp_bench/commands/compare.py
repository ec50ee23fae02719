"""``mtp-bench compare``."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Exit, Option

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

DetectionFiles = Annotated[
    list[Path] | None,
    Option(help="Stored detections, as of `run`; several have a row each."),
]
TrackFiles = Annotated[
    list[Path] | None,
    Option(help="Stored tracks, as of `run`; several have a row each."),
]


@dataclass(frozen=True)
class ComparedScenes(AgentScenes):
    """Scenes of a comparison, with several files of tracks or of detections."""

    detections: DetectionFiles = None  # type: ignore[assignment]
    tracks: TrackFiles = None  # type: ignore[assignment]

    def choices(
        self, workers: WorkerChoice, seeds: Sequence[int]
    ) -> dict[str, RunOptions]:
        """Return the options with each file, by its name.

        Raises BadParameter for several tracks and several detections at once.
        """
        tracks = self.tracks or [Path()]
        detections = self.detections or [Path()]
        varied = tracks if len(tracks) > 1 else detections
        if len(tracks) * len(detections) > len({path.name for path in varied}):
            raise BadParameter(
                "expected several files, of different names, of one kind alone",
                param_hint="--tracks, --detections",
            )
        choices = {}
        for track_file, detection_file in itertools.product(tracks, detections):
            values = {field.name: getattr(self, field.name) for field in fields(self)}
            values["tracks"] = track_file if self.tracks else None
            values["detections"] = detection_file if self.detections else None
            name = (track_file if len(tracks) > 1 else detection_file).name
            choices[name] = AgentScenes(**values).options(workers, seeds)
        return choices


def compare(
    agents: Annotated[
        list[str],
        Argument(
            help="Names of baselines, folders of submissions or of stored runs.",
        ),
    ],
    on: ComparedScenes,
    workers: WorkerChoice,
    shown: Shown,
    seeds: SeedsOption = SEEDS,
    json_file: JsonOption = None,
    train: Annotated[
        bool,
        Option("--train", help="First train the networks that have no weights here."),
    ] = False,
) -> None:
    """Run agents, ground-truth tracks and the controls on the same scenes.

    Prints one table and the verdict.
    """
    choices = on.choices(workers, range(seeds))
    options = next(iter(choices.values()))
    env = on.card
    playing = [agent for agent in agents if not is_run(agent)]
    doubts = prepare(env, options, playing, on.no_doctor)
    if train:
        from .train import train_missing

        train_missing(agents, env if isinstance(env, str) else env.id, options)
    if options.card(env).drive is not None:
        _compare_driving(agents, env, options, shown, json_file)
        return
    if len(choices) > 1:
        result = compare_files(agents, env, choices)
    else:
        full = shown.is_full or json_file is not None
        result = run_comparison(agents, env, options, full)
    content = result.report.to_json("condition", "paired", "details", "failures")
    doubt_texts = [f"{doubt.scene}: {doubt.line}" for doubt in doubts]
    write_json(json_file, content | {"skipped": result.skipped, "doubts": doubt_texts})
    names = result.names(agents)
    show_report(result.report, counted(seeds, "seed"), result.skipped, shown, names)
    if len(choices) > 1:
        show_differences(result.report, shown)
    if result.report.failures:
        raise Exit(1)


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
