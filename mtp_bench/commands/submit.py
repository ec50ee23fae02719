"""``mtp-bench submit``."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from ..cards import load_card
from ..errors import MtpBenchError, RecordError
from ..records import Record
from ..records import submit as make_record
from ..records.inventory import Piece, inventory
from ..records.submitting import record_path, require_target
from ..running.options import RunOptions
from ..submission.loader import Submission, load_submission
from ..tables import Table, columns_of
from ..viz.terminal.output import counted, show, show_table
from .options import SEEDS, DataOption, SeedsOption, WorkerChoice, env_ids, submissions
from .output import prepare, said_of, say, some_of, working
from .submit_all import make_all, summary_table

SHOWN = ("subset", "error", "interval", "plain_error", "minADE", "minFDE", "coverage", "targets", "objects", "scenes")


@dataclass(frozen=True)
class EntryOptions:
    """Options of the entry on the leaderboard, and of an earlier submit of it."""

    seeds: SeedsOption = SEEDS
    scenes: Annotated[int | None, Option(min=1, help="Only the first N scenes: a record without a rank.")] = None
    commit: Annotated[str, Option(help="Commit that holds the folder: 7 to 64 hex digits.")] = ""
    resume: Annotated[bool, Option("--resume", help="Continue with scenes that were finished before.")] = False
    force: Annotated[bool, Option("--force", help="Replace a finished record by one that cannot rank.")] = False

    def arguments(self) -> dict[str, Any]:
        """Arguments of `records.submit`; BadParameter for what is not a commit."""
        if not re.fullmatch("([0-9a-f]{7,64})?", self.commit):
            raise BadParameter(f"got {self.commit!r}, expected 7 to 64 hex digits", param_hint="--commit")
        return {"commit": self.commit, "resume": self.resume, "replace": self.force}


def submit(
    workers: WorkerChoice,
    entry: EntryOptions,
    path: Annotated[
        str | None, Argument(help="Folder of a submission or name of a baseline.", autocompletion=submissions)
    ] = None,
    env: Annotated[list[str] | None, Option(help="Environment id; repeatable.", autocompletion=env_ids)] = None,
    everything: Annotated[
        bool, Option("--all", help="Every baseline on every environment, or those of --env; keeps finished ones.")
    ] = False,
    root: DataOption = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Folder; leaderboard/records/<name> by default.")
    ] = None,
) -> None:
    """Run a submission behind the gateway and write its records for the leaderboard; with --all every baseline."""
    arguments = entry.arguments()
    options = RunOptions(root, entry.scenes, range(entry.seeds), workers=workers.workers())
    if everything:
        if entry.commit:
            raise BadParameter("not with --all", param_hint="--commit")
        listed = inventory(env or (), () if path is None else (path,), output)
        _submit_all(listed, options, {"resume": True, "replace": entry.force})
        return
    if path is None:
        raise BadParameter("name a submission, or --all", param_hint="PATH")
    if not env:
        raise BadParameter("name an environment, or --all", param_hint="--env")
    _submit_one(path, env, options, output, arguments)


def _submit_all(pieces: Sequence[Piece], options: RunOptions, arguments: Mapping[str, Any]) -> None:
    """Make the missing records of a leaderboard."""

    def make(piece: Piece) -> Record:
        return _one(piece.submission, piece.env, options, piece.target.parent, arguments)

    lines = make_all(pieces, options, make)
    show_table(summary_table(lines))
    if all(line.outcome == "not here" for line in lines):
        raise RecordError(f"no record can be made here, the first: {lines[0].note}")
    failed = [
        f"{line.piece.submission.name} on {line.piece.env}: {line.note}" for line in lines if line.outcome == "failed"
    ]
    if failed:
        raise RecordError(some_of(failed))


def _submit_one(
    path: str, env_ids: Sequence[str], options: RunOptions, output: Path | None, arguments: Mapping[str, Any]
) -> None:
    """Make the records of one submission on the named environments, and show them."""
    submission = load_submission(path)
    targets = {env_id: record_path(submission, load_card(env_id), output) for env_id in env_ids}
    for target in targets.values():
        require_target(target, submission, options, arguments["resume"], arguments["replace"])
    failed = []
    for env_id, target in targets.items():
        try:
            record = _one(submission, env_id, options, output, arguments)
        except (MtpBenchError, OSError) as error:  # the others are worth their time
            if len(targets) == 1:
                raise
            failed.append(f"{env_id}: {said_of(error)}")
            say(failed[-1])
            continue
        show_table(_record_table(record))
        show(f"{target}: {_sentence(record)}")
        if record.status in ("crashed", "rejected"):
            failed.append(f"{record.env.id}: {record.status}: {record.status_reason}")
    if failed:
        raise RecordError(some_of(failed))


def _one(
    submission: Submission, env_id: str, options: RunOptions, output: Path | None, arguments: Mapping[str, Any]
) -> Record:
    """Make the record of one env with a progress bar."""
    card = load_card(env_id)
    if card.lanes is not None and not card.simulated:
        say(f"{card.id} shows lanes, which tell the place of a recorded scene: no random motion of the scene hides it.")
    prepare(env_id, options)
    with working(f"running {submission.name} on {env_id}", options) as watched:
        return make_record(submission.path, env_id, watched, output, **arguments)


def _record_table(record: Record) -> Table:
    """One line per subset."""
    title = f"{record.submission.name} on {record.env.id}: error at the false-forecast budgets (m, less is better)"
    return Table("record", title, "", record.rows, [each for each in columns_of(type(record.row)) if each.key in SHOWN])


def _sentence(record: Record) -> str:
    """Status, times and failures in one line."""
    latency, missed = record.measured.latency, record.missed
    parts = [f"{record.status}{f' ({record.status_reason})' if record.status_reason else ''}"]
    if latency.p50_ms is not None and latency.p95_ms is not None:
        parts.append(f"{latency.p50_ms:.1f} ms per frame, 95 % within {latency.p95_ms:.1f} ms")
    parts += [f"{record.measured.peak_memory_mib:.0f} MiB", record.reference.origin]
    if missed.malformed:
        parts.append(f"{missed.malformed} malformed answers")
    if missed.crashed_scenes:
        reason = next(iter(missed.reasons.values()), "")
        parts.append(f"{counted(missed.crashed_scenes, 'scene')} not finished ({reason})")
    return "; ".join(parts)
