"""Commands that run agents and score what they said."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import MtpBenchError
from .shared import (
    BackendOption,
    DataOption,
    DetectionsOption,
    DetectorOption,
    EnvOption,
    JobsOption,
    JsonOption,
    ScenesOption,
    SchedulerOption,
    SeedOption,
    SplitOption,
    condition,
    count,
    given,
    prepare,
    require_backend_options,
    require_writable,
    show_report,
    show_skipped,
    workers,
    write_json,
)


def envs(json_file: JsonOption = None) -> None:
    """List the environments."""
    from .._bundle import card_ids
    from ..cards import load_card
    from ..viz.terminal.listings import env_table
    from ..viz.terminal.output import show

    cards = [load_card(env_id) for env_id in card_ids()]
    write_json(json_file, {card.id: {**card.model_dump(mode="json"), "digest": card.digest} for card in cards})
    show(env_table(cards))


def data(
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None,
    root: DataOption = None,
    json_file: JsonOption = None,
    split: SplitOption = None,
) -> None:
    """Show which data is found, what is missing and how to get it.

    Status 1 for broken files; with --env also for data that is not there.
    """
    from .._bundle import card_ids
    from ..cards import changed_card, load_card
    from ..running.reading import read_status
    from ..viz.terminal.listings import data_report, status_json
    from ..viz.terminal.output import show

    if split is not None and env is None:
        raise typer.BadParameter("the splits of environments differ: name one with --env", param_hint="--split")
    cards = [changed_card(load_card(env_id), split) for env_id in ([env] if env else card_ids())]
    statuses = {card.id: read_status(card, root) for card in cards}
    write_json(json_file, {env_id: status_json(status) for env_id, status in statuses.items()})
    show(data_report(statuses))
    lacking = [env_id for env_id, status in statuses.items() if status.problems or (env and not status.usable)]
    if lacking:
        raise MtpBenchError(f"data is missing or broken for {', '.join(lacking)}: the listing says what and why")


def run(
    agent: Annotated[str, typer.Argument(help="Name of a baseline or folder of a submission.")],
    env: EnvOption,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the rollouts.")],
    root: DataOption = None,
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    seed: SeedOption = 0,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    backend: BackendOption = "loky",
    scheduler: SchedulerOption = None,
) -> None:
    """Run an agent and store what it said."""
    from ..running.stored import run_and_store
    from ..viz.terminal.output import progress_bar, show

    require_backend_options(backend, scheduler)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, jobs, changes)
    with progress_bar(agent) as (started, done):
        size = scenes, workers(jobs), seed
        stored = run_and_store(agent, env, output, root, *size, started, done, changes, backend, scheduler)
    show_skipped(stored.skipped)
    show(f"{count(stored.scenes, 'scene')} of {env} by {agent} in {output}; score with `mtp-bench score {output}`")


def score(
    folder: Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")],
    root: DataOption = None,
    env: Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    from ..running.stored import score_stored
    from ..viz.terminal.output import progress_bar, show

    require_writable(json_file)
    with progress_bar("score") as (started, done):
        scored = score_stored(folder, root, started, done, env)
    report = scored.report
    write_json(json_file, {**report.to_json("condition", "details"), "skipped": scored.skipped})
    show_report(report, f"{condition(report)}: {folder.name}")
    show(scored.origin)
    show_skipped(scored.skipped)


def compare(
    agents: Annotated[list[str], typer.Argument(help="Names of baselines or folders of submissions.")],
    env: EnvOption,
    root: DataOption = None,
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Runs with different random draws.")] = 3,
    reference: Annotated[
        str | None, typer.Option("--reference", help="Take the subsets from this agent's events, not the frozen ones.")
    ] = None,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    json_file: JsonOption = None,
    backend: BackendOption = "loky",
    scheduler: SchedulerOption = None,
) -> None:
    """Run agents side by side, with true pasts and the controls beside them, and print the comparison."""
    from ..running.compare import compare as run_comparison
    from ..viz.terminal.findings import findings
    from ..viz.terminal.output import progress_bar, show

    require_writable(json_file)
    require_backend_options(backend, scheduler)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, jobs, changes)
    keywords = {**given(data=root), **changes}
    with progress_bar("compare") as (started, done):
        size = scenes, range(seeds), workers(jobs)
        result = run_comparison(agents, env, keywords, *size, started, done, reference, backend, scheduler)
    report = result.report
    content = report.to_json("condition", "ranks", "paired", "details")
    write_json(json_file, {**content, "skipped": result.skipped})
    show_report(report, f"{condition(report)}: missing-aware error (m), {count(seeds, 'seed')} of sampling")
    show(result.reference.origin)
    show_skipped(result.skipped)
    for sentence in findings(report):
        show(f"• {sentence}")
