"""The command line: ``mtp-bench``. Exit status 0, 1 for a failure that the message explains, 2 for wrong usage."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Annotated

import typer

from ._command_line import (
    BackendOption,
    DataOption,
    DetectionsOption,
    DetectorOption,
    EnvOption,
    FolderArgument,
    JobsOption,
    JsonOption,
    RunCardOption,
    ScenesOption,
    SchedulerOption,
    SeedOption,
    SplitOption,
    condition,
    count,
    fail,
    given,
    prepare,
    require_backend_options,
    require_writable,
    show_report,
    show_skipped,
    workers,
    write_json,
)
from .errors import MtpBenchError

app = typer.Typer(
    help="Tracking and prediction together: your agent sees detections, not the truth.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
def envs(json_file: JsonOption = None) -> None:
    """List the environments."""
    from ._bundle import card_ids
    from .cards import load_card
    from .viz.listings import env_table
    from .viz.terminal import show

    cards = [load_card(env_id) for env_id in card_ids()]
    write_json(json_file, {card.id: {**card.model_dump(mode="json"), "digest": card.digest} for card in cards})
    show(env_table(cards))


@app.command()
def data(
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None,
    root: DataOption = None,
    json_file: JsonOption = None,
    split: SplitOption = None,
) -> None:
    """Show which data is found, what is missing and how to get it.

    Status 1 for broken files; with --env also for data that is not there.
    """
    from ._bundle import card_ids
    from .cards import changed_card, load_card
    from .submission.reading import read_status
    from .viz.listings import data_report, status_json
    from .viz.terminal import show

    if split is not None and env is None:
        raise typer.BadParameter("the splits of environments differ: name one with --env", param_hint="--split")
    cards = [changed_card(load_card(env_id), split) for env_id in ([env] if env else card_ids())]
    statuses = {card.id: read_status(card, root) for card in cards}
    write_json(json_file, {env_id: status_json(status) for env_id, status in statuses.items()})
    show(data_report(statuses))
    lacking = [env_id for env_id, status in statuses.items() if status.problems or (env and not status.usable)]
    if lacking:
        raise MtpBenchError(f"data is missing or broken for {', '.join(lacking)}: the listing says what and why")


@app.command()
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
    from .submission.stored import run_and_store
    from .viz.terminal import progress_bar, show

    require_backend_options(backend, scheduler)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, jobs, changes)
    with progress_bar(agent) as (started, done):
        size = scenes, workers(jobs), seed
        stored = run_and_store(agent, env, output, root, *size, started, done, changes, backend, scheduler)
    show_skipped(stored.skipped)
    show(f"{count(stored.scenes, 'scene')} of {env} by {agent} in {output}; score with `mtp-bench score {output}`")


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")],
    root: DataOption = None,
    env: Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    from .submission.stored import score_stored
    from .viz.terminal import progress_bar, show

    require_writable(json_file)
    with progress_bar("score") as (started, done):
        scored = score_stored(folder, root, started, done, env)
    report = scored.report
    further = {"condition": report.condition, "details": report.details, "skipped": scored.skipped}
    write_json(json_file, {**report.to_json(), **further})
    show_report(report, f"{condition(report)}: {folder.name}")
    show(scored.origin)
    show_skipped(scored.skipped)


@app.command()
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
    from .submission.compare import compare as run_comparison
    from .viz.findings import findings
    from .viz.terminal import progress_bar, show

    require_writable(json_file)
    require_backend_options(backend, scheduler)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, jobs, changes)
    keywords = {**given(data=root), **changes}
    with progress_bar("compare") as (started, done):
        size = scenes, range(seeds), workers(jobs)
        result = run_comparison(agents, env, keywords, *size, started, done, reference, backend, scheduler)
    report = result.report
    further = {"condition": report.condition, "ranks": report.ranks, "paired": report.paired}
    further |= {"details": report.details, "skipped": result.skipped}
    write_json(json_file, {**report.to_json(), **further})
    show_report(report, f"{condition(report)}: missing-aware error (m), {count(seeds, 'seed')} of sampling")
    show(result.reference.origin)
    show_skipped(result.skipped)
    for sentence in findings(report):
        show(f"• {sentence}")


@app.command()
def view(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders written by `mtp-bench run`; several are shown side by side.")
    ],
    scene: Annotated[str | None, typer.Option("--scene", help="Which scene; the first of the run.")] = None,
    at: Annotated[str | None, typer.Option("--at", help="Open at this event; `mtp-bench events` lists them.")] = None,
    level: Annotated[
        str,
        typer.Option("--level", help="off, tracks, top (3 samples per object) or all (every sample and hypothesis)."),
    ] = "top",
    save: Annotated[Path | None, typer.Option("--save", help="Write a recording (.rrd) instead.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine instead.")] = False,
    root: DataOption = None,
    env: Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")] = None,
) -> None:
    """Look at tracks, hypotheses, forecasts and events of stored rollouts in rerun."""
    from ._view import view_runs
    from .viz.recording_arrays import LEVELS
    from .viz.terminal import show

    if level not in LEVELS:
        raise typer.BadParameter(f"{level!r}, expected one of: {', '.join(LEVELS)}", param_hint="--level")
    if save is not None and web:
        raise typer.BadParameter("a recording is either written or served", param_hint="--save, --web")
    if save is not None and save.suffix != ".rrd":
        raise typer.BadParameter(f"{save}: the viewer opens files that end in .rrd", param_hint="--save")
    require_writable(save)
    view_runs(folders, scene, at, level, save, web, root, env, show)


@app.command()
def events(
    folder: FolderArgument,
    scene: Annotated[str | None, typer.Option("--scene", help="Only this scene.")] = None,
    kind: Annotated[
        list[str] | None, typer.Option("--kind", help="Only ids, lost, reacquired or spurious; repeatable.")
    ] = None,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """List identity switches, losses, re-acquisitions and forecasts of nothing, and how to look at each."""
    from .submission.opened import open_run
    from .viz.event_table import EventRow, Shown, Tally, event_rows, event_table, events_json, longest_only, tally_line
    from .viz.replay import KINDS, replay
    from .viz.terminal import progress_bar, show, show_numbers

    for name in kind or ():
        if name not in KINDS:
            raise typer.BadParameter(f"{name!r}, expected one of: {', '.join(KINDS)}", param_hint="--kind")
    require_writable(json_file)
    shown, tally = Shown(str(folder), root, env), Tally()
    rows: list[EventRow] = []
    with progress_bar("events") as (started, done):
        opened = open_run(folder, root, env)
        rollouts = opened.rollouts(scene)
        started(len(rollouts))
        for rollout in rollouts:
            played = replay(opened.scene(rollout.scene), rollout, opened.card, opened.run.info.agent)
            tally.add(played)
            rows += event_rows(played, kind or KINDS, shown)
            done(rollout.scene)
    write_json(json_file, events_json(rows, tally, opened.card.id, opened.run.info.agent))
    listed = rows if kind else longest_only(rows)
    if listed:
        show_numbers(event_table(listed))
    show(tally_line(tally, all_listed=len(listed) == len(rows)))


@app.command()
def video(
    folder: FolderArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .mp4 or .gif.")],
    scene: Annotated[str | None, typer.Option("--scene", help="Which scene; the first of the run.")] = None,
    at: Annotated[
        str | None, typer.Option("--at", help="Only 2 s before and after this event; `mtp-bench events` lists them.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option("--fps", min=0.1, max=50, help="Pictures per second; as many as were recorded.")
    ] = None,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write a scene of a stored rollout as a video, seen from above."""
    from .submission.opened import open_run
    from .viz.replay import replay
    from .viz.terminal import progress_bar, show
    from .viz.video import KINDS, frames_around, pictures, require_encoder, write_video

    suffix = output.suffix.lower()
    if suffix not in KINDS:
        raise typer.BadParameter(f"{output}: expected a name that ends in {' or '.join(KINDS)}", param_hint="--output")
    require_writable(output)
    require_encoder(suffix)
    with progress_bar("video") as (started, done):
        opened = open_run(folder, root, env)
        rollout = opened.first(scene)
        played = replay(opened.scene(rollout.scene), rollout, opened.card, opened.run.info.agent)
        frames = frames_around(played, at)
        started(len(frames))
        rate = fps or opened.card.task.rate
        write_video(output, pictures(played, frames, at), rate, lambda: done(rollout.scene))
    show(f"{output}: scene {rollout.scene}, frames {frames.start} to {frames.stop - 1}, {rate:g} per second")


@app.command()
def train(
    what: Annotated[str, typer.Argument(help="What to fit: motion-noise or operating-point.")],
    env: EnvOption,
    root: DataOption = None,
    observe: Annotated[
        str, typer.Option("--observe", help="detections or truth: what the pasts are made of.")
    ] = "detections",
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")] = None,
) -> None:
    """Fit the parameters of a baseline on the training split of an environment (or another)."""
    from .submission.files import write_text
    from .submission.training import KINDS, fit_motion_noise, fit_operating_point
    from .viz.terminal import progress_bar

    require_writable(output)
    if what not in KINDS:
        raise typer.BadParameter(f"{what!r} cannot be fitted, expected one of: {', '.join(KINDS)}", param_hint="WHAT")
    if what == "operating-point" and observe != "detections":
        raise typer.BadParameter("true boxes have no scores to choose by", param_hint="--observe")
    changes = {"split": "train", **given(split=split, detector=detector, detection_file=detections)}
    prepare(env, root, scenes, jobs, changes)
    with progress_bar("read") as (started, done):
        if what == "operating-point":
            text = fit_operating_point(env, root, started, done, scenes, changes)
        else:
            text = fit_motion_noise(env, root, observe, started, done, scenes, changes)
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


@app.command("fit-noise")
def fit_noise(
    env: EnvOption,
    root: DataOption = None,
    scenes: ScenesOption = None,
    split: SplitOption = None,
    detector: DetectorOption = None,
    detections: DetectionsOption = None,
    min_score: Annotated[
        list[str] | None, typer.Option("--min-score", help="Operating point: a number, or class=number; repeatable.")
    ] = None,
    alike: Annotated[
        list[str] | None,
        typer.Option("--alike", help="bus=car: its noise, where bus cannot be fitted; repeatable."),
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the profile; agents go by the part before its first hyphen.")
    ] = None,
    reach: Annotated[
        float | None, typer.Option("--reach", min=1, max=1000, help="How far the detector sees, metres.")
    ] = None,
    field_of_view: Annotated[
        float | None, typer.Option("--field-of-view", min=1, max=360, help="Degrees around the heading.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")] = None,
) -> None:
    """Fit the noise of a simulated detector to the detections of an environment, as a section of a card."""
    from .submission.files import write_text
    from .submission.fitting import fit_noise as fit
    from .viz.terminal import progress_bar

    require_writable(output)
    changes = given(split=split, detector=detector, detection_file=detections)
    prepare(env, root, scenes, 0, changes)
    with progress_bar("read") as (started, done):
        text = fit(env, root, scenes, changes, min_score or (), alike or (), name, reach, field_of_view, started, done)
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the submission: lower case.")],
    folder: Annotated[Path, typer.Option("--folder", help="Where its folder is made.")] = Path(),
) -> None:
    """Begin a submission: a folder with an agent that works."""
    from ._new import begin
    from .viz.terminal import show

    show(begin(name, folder))


@app.command()
def check(
    path: Annotated[str, typer.Argument(help="Folder of a submission or name of a baseline.")],
    env: Annotated[
        str, typer.Option("--env", help="Environment to check on; `mtp-bench envs` lists them.")
    ] = "MTP-Intersection-v0",
    root: DataOption = None,
    json_file: JsonOption = None,
) -> None:
    """Check that a submission keeps the contract, and score three scenes beside STP. Status 1 for errors."""
    from ._check import SCENES, check_submission, finding_table, score_table, verdict
    from .viz.terminal import progress_bar, show, show_numbers

    require_writable(json_file)
    prepare(env, root, SCENES, 0, {})
    with progress_bar("check") as (started, done):
        checked = check_submission(path, env, root, started, done)
    write_json(json_file, checked.to_json())
    show(finding_table(checked))
    if checked.scores:
        show_numbers(score_table(checked))
    show(verdict(checked, path))


@app.command()
def submit(
    path: Annotated[str, typer.Argument(help="Folder of a submission or name of a baseline.")],
    env: Annotated[list[str], typer.Option("--env", help="Environment id; repeatable.")],
    root: DataOption = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Runs with different random draws and frames.")] = 3,
    scenes: Annotated[
        int | None, typer.Option("--scenes", min=1, help="Only the first N scenes: a partial record, never ranked.")
    ] = None,
    split: Annotated[
        str | None, typer.Option("--split", help="Another split, such as train: a partial record, never ranked.")
    ] = None,
    jobs: JobsOption = 0,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder; leaderboard/records/<name> by default.")
    ] = None,
    division: Annotated[str, typer.Option("--division", help="closed or open.")] = "closed",
    training_data: Annotated[
        list[str] | None, typer.Option("--training-data", help="What else the agent was trained on than its manifest says; repeatable.")
    ] = None,
    backend: BackendOption = "loky",
    scheduler: SchedulerOption = None,
) -> None:
    """Run a submission behind the gateway and write its records for the leaderboard."""
    from ._submit import DIVISIONS, submit_all

    if division not in DIVISIONS:
        raise typer.BadParameter(f"{division!r}, expected one of: {', '.join(DIVISIONS)}", param_hint="--division")
    require_backend_options(backend, scheduler)
    trained = training_data or ()
    submit_all(path, env, root, seeds, scenes, workers(jobs), output, division, trained, scheduler, split)


@app.command()
def verify(
    record: Annotated[Path, typer.Argument(help="A record, or a folder: all records in it.")],
    root: DataOption = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Run the submission again, not only its scorer.")] = False,
    submission: Annotated[
        Path | None, typer.Option("--submission", help="Folder to run again; else the baseline of that name.")
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write the level reached, or new numbers where the scorer changed.")
    ] = False,
    hidden: Annotated[
        Path | None, typer.Option("--hidden", help="Secret of `mtp-bench seal`: with --rerun, run its scenes too.")
    ] = None,
    commitment: Annotated[
        Path | None, typer.Option("--commitment", help="What the secret was promised with; the file beside it.")
    ] = None,
    jobs: JobsOption = 0,
    env: Annotated[str | None, typer.Option("--env", help="Card of the record, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again. Status 1 where one does not hold."""
    from ._submit import verify_all

    if submission is not None and not rerun:
        raise typer.BadParameter("is for running it again: add --rerun", param_hint="--submission")
    if hidden is not None and not rerun:
        raise typer.BadParameter("is for running the submission: add --rerun", param_hint="--hidden")
    if commitment is not None and hidden is None:
        raise typer.BadParameter("belongs to a secret: name it with --hidden", param_hint="--commitment")
    require_writable(json_file)
    verify_all(record, root, env, submission, rerun, write, workers(jobs), json_file, hidden, commitment)


@app.command()
def seal(
    env: EnvOption,
    scenes: Annotated[int, typer.Option("--count", min=1, max=1000, help="Number of hidden scenes.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File of the secret; its commitment goes beside it.")],
) -> None:
    """Draw secret scenes of a simulated environment and commit to them (maintainers)."""
    from ._submit import seal_env

    seal_env(env, scenes, output)


@app.command()
def board(
    further: Annotated[
        list[Path] | None, typer.Option("--with", help="A record to place among the others; repeatable.")
    ] = None,
    records: Annotated[
        Path | None, typer.Option("--records", help="Folder of records; those that ship by default.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Also write a page that needs no network: a .html file.")
    ] = None,
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Show the leaderboard: a table per environment, and a page to open in a browser."""
    from ._board import show_board

    for path in (json_file, output):
        require_writable(path)
    show_board(records, further or (), env, output, json_file)


@app.command(hidden=True)
def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen subsets of a shipped environment (maintainers)."""
    from .submission.reference import freeze as write
    from .viz.terminal import progress_bar, show

    prepare(env, root, None, jobs, {})
    with progress_bar("freeze") as (started, done):
        path, counts = write(env, root, workers(jobs), started, done)
    show(f"{path}: {counts}")


def main() -> None:
    """Entry point: errors of the library become one line and exit status 1."""
    # joblib renews workers that hold much memory, and says so; nothing is lost by it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        app(prog_name="mtp-bench")
    except MtpBenchError as error:
        fail(str(error))
    except OSError as error:  # a full disk, a file without permission
        fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))


if __name__ == "__main__":
    main()
