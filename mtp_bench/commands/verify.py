"""``mtp-bench verify``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import MtpBenchError, RecordError
from ..files import clean_text
from ..records import checked_record, record_paths, trusted
from ..records.canonical import Difference
from ..records.eligibility import LEAST_HIDDEN
from ..records.seal import open_seals
from ..records.trust import Trust
from ..records.verifying import Round, Verification, attest
from ..running.options import RunOptions
from ..tables import Column, Table, short
from ..viz.terminal.output import counted, show, show_lines, show_table
from .options import BaseOption, DataOption, JobsOption, JsonOption, WorkerChoice
from .output import said_of, some_of, working, write_json

MOST_DIFFERENCES = 20  # shown per record
MOST_LETTERS = 60  # of a value in the table


@dataclass(frozen=True)
class RunningAgain:
    """Options of running submissions again."""

    rerun: Annotated[bool, typer.Option("--rerun", help="Run the submission again, also under a secret seed.")] = False
    submission: Annotated[
        Path | None,
        typer.Option(help="Submission to run again, or a folder of them by name; else the baseline of that name."),
    ] = None
    hidden: Annotated[
        Path | None,
        typer.Option(help="Secret of `maintain seal`, or a folder of them: with --rerun, run its scenes."),
    ] = None


@dataclass(frozen=True)
class Signing:
    """Options of signing and of trust."""

    sign: Annotated[Path | None, typer.Option(help="Private SSH key: sign the level that is reached.")] = None
    signer: Annotated[str | None, typer.Option(help="Name of its owner, as in keys/allowed_signers.")] = None
    base: BaseOption = None


@dataclass(frozen=True)
class _Work:
    """The check of every record."""

    asked: Round
    trust: Trust
    options: RunOptions
    env: str | None
    key: Path | None
    signer: str


@dataclass(frozen=True)
class _Result:
    """Outcome of the check of one record."""

    path: Path
    verdict: dict[str, Any]
    failed: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """Name of the submission and id of the env."""
        return f"{self.path.parent.name}/{self.path.stem}"

    @property
    def note(self) -> str:
        """Reason why the record has no level."""
        return "error" if "error" in self.verdict else "does not hold" if self.failed else ""


def verify(
    record: Annotated[list[Path], typer.Argument(help="Records, or folders: all records in them.")],
    again: RunningAgain,
    signing: Signing,
    root: DataOption = None,
    jobs: JobsOption = 0,
    env: Annotated[str | None, typer.Option(help="Card of the record if it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again. Status 1 if one does not hold."""
    rerun = ("--rerun", again.rerun)
    for option, given, (needed, there) in (
        ("--submission", again.submission, rerun),
        ("--hidden", again.hidden, rerun),
        ("--sign", signing.sign, ("--signer", signing.signer)),
        ("--signer", signing.signer, ("--sign", signing.sign)),
    ):
        if given and not there:
            raise typer.BadParameter(f"needs {needed}", param_hint=option)
    trust = trusted(signing.base)
    seals = {} if again.hidden is None else open_seals(again.hidden, trust.listed)
    asked = Round(again.rerun, seals, again.submission)
    options = RunOptions(root, workers=WorkerChoice(jobs).workers())
    _check_all(record, _Work(asked, trust, options, env, signing.sign, signing.signer or ""), json_file)


def _check_all(given: Sequence[Path], work: _Work, json_file: Path | None) -> None:
    paths = list(dict.fromkeys(path for each in given for path in (record_paths(each) if each.is_dir() else [each])))
    if not paths:
        raise RecordError(f"{given[0]}: no record there, expected files <submission>/<env id>.json")
    if work.key is not None:
        work.trust.require_signer(work.key, work.signer)
        work.trust.require_listed(work.asked.seals.values())
    with ExitStack() as ends:  # hidden scenes are made once for all records
        results = [_check_one(path, work, ends, alone=list(given) == [path]) for path in paths]
    if len(results) > 1:
        show_table(_summary(results), first_width=None, wrapped=("note",))
    write_json(json_file, {"records": [result.verdict for result in results]})
    failed = [result.failed for result in results if result.failed]
    if failed:
        raise RecordError(some_of(failed))


def _check_one(path: Path, work: _Work, ends: ExitStack, alone: bool) -> _Result:
    """Check one record; an error of one among several does not stop the others."""
    start = time.monotonic()
    try:
        result = _checked(path, work, ends)
    except (MtpBenchError, OSError) as error:
        if alone:
            raise
        result = _Result(path, {"record": str(path), "error": said_of(error)}, said_of(error))
    return replace(result, seconds=time.monotonic() - start)


def _checked(path: Path, work: _Work, ends: ExitStack) -> _Result:
    record = checked_record(path)
    done = work.asked.reached(path, record, work.trust) if work.key is not None else None
    if done is not None:
        show(f"{path}: {done.level} since {done.statement.date}, signed by {done.signer}")
        error = None if done.hidden is None else done.hidden.row.error
        known = {"record": str(path), "digest": record.digest, "level": done.level, "hidden_error": error}
        return _Result(path, {**known, "holds": True})
    with working(f"verify {record.submission.name} on {record.env.id}", work.options) as watched:
        checked = work.asked.verify(path, record, watched, work.env, ends)
    if checked.differences:
        _show_differences(checked)
    show(_verdict(checked))
    if work.key is not None and checked.holds:
        show(f"{attest(checked, work.key, work.signer, work.trust)}: {checked.level}, signed by {work.signer}")
    differ = f"{path}: {counted(len(checked.differences), 'difference')} to what was found here"
    return _Result(path, _as_json(checked), "" if checked.holds else differ)


def _show_differences(checked: Verification) -> None:
    shown = checked.differences[:MOST_DIFFERENCES]
    columns = [Column(key=key, read=_cut(key)) for key in ("what", "recorded", "found")]
    show_table(Table("differences", f"{checked.path}: differences", "", shown, columns), first_width=None)
    more = len(checked.differences) - len(shown)
    show_lines([f"and {more} more"] if more else [])


def _cut(key: str) -> Callable[[Difference], str]:
    return lambda difference: clean_text(str(getattr(difference, key)), MOST_LETTERS)


def _summary(results: Sequence[_Result]) -> Table:
    """One line per record."""
    columns = (
        Column("record", key="name"),
        Column(key="level", read=lambda result: result.verdict.get("level")),
        Column(key="hidden error", read=lambda result: result.verdict.get("hidden_error")),
        Column(key="minutes", format=".1f", read=lambda result: result.seconds / 60),
        Column(key="note"),
    )
    return Table("records", "records", "", results, columns)


def _as_json(checked: Verification) -> dict[str, Any]:
    return {
        "record": str(checked.path),
        "digest": checked.record.digest,
        "holds": checked.holds,
        "level": checked.level,
        "hidden_error": None if checked.hidden is None else checked.hidden.row.error,
        "differences": [difference._asdict() for difference in checked.differences],
        "notes": list(checked.notes),
    }


def _verdict(checked: Verification) -> str:
    record, hidden = checked.record, checked.hidden
    subject = f"{checked.path}: {record.submission.name} on {record.env.id}"
    sentences = [f"{subject}: holds, {checked.level}" if checked.holds else f"{subject}: does not hold"]
    if hidden is not None:
        few = "" if hidden.scenes >= LEAST_HIDDEN else f", too few to rank: ranks need {LEAST_HIDDEN}"
        sentences.append(f"error {short(hidden.row.error)} m on {counted(hidden.scenes, 'hidden scene')}{few}")
    return ". ".join([*sentences, *checked.notes])
