"""``mtp-bench verify``."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from ..core import Column, MtpBenchError, RecordError, Table, clean_text, short
from ..judge import (
    LEAST_HIDDEN,
    Difference,
    HiddenPart,
    Round,
    Trust,
    Verification,
    attest,
    checked_record,
    open_seals,
    record_paths,
    trusted,
)
from ..running import RunOptions
from ..viz import counted, show, show_lines, show_table
from .options import BaseOption, DataOption, JobsOption, JsonOption, WorkerChoice
from .output import said_of, some_of, working, write_json

MOST_DIFFERENCES = 20  # shown per record
MOST_LETTERS = 60  # of a value in the table


@dataclass(frozen=True)
class VerifyOptions:
    """Options of a check: runs that are repeated, and the signature of the level."""

    rerun: Annotated[
        bool,
        Option("--rerun", help="Run the submission again, also under a secret seed."),
    ] = False
    submission: Annotated[
        Path | None,
        Option(
            help="Submission to run again, or a folder of them by name; else the baseline of that name."
        ),
    ] = None
    made_here: Annotated[
        bool,
        Option(
            "--made-here",
            help="You made these records of baselines: do not repeat their public runs.",
        ),
    ] = False
    hidden: Annotated[
        Path | None,
        Option(
            help="Secret of `maintain seal`, or a folder of them: with --rerun, run its scenes."
        ),
    ] = None
    sign: Annotated[
        Path | None, Option(help="Private SSH key: sign the level that is reached.")
    ] = None
    signer: Annotated[
        str | None, Option(help="Name of its owner, as in keys/allowed_signers.")
    ] = None
    looked_at: Annotated[
        bool,
        Option(
            "--looked-at",
            help="Sign that you looked at it: it may be better than ground truth.",
        ),
    ] = False
    base: BaseOption = None
    env: Annotated[
        str | None, Option(help="Card of the record if it does not ship.")
    ] = None

    def require_together(self) -> None:
        """Raise BadParameter for an option without the one that it needs."""
        needs = dict.fromkeys(("submission", "hidden", "made_here"), "rerun")
        needs |= {"sign": "signer", "signer": "sign", "looked_at": "sign"}
        for name, needed in needs.items():
            if getattr(self, name) and not getattr(self, needed):
                raise BadParameter(
                    f"needs --{needed}", param_hint=f"--{name.replace('_', '-')}"
                )


@dataclass(frozen=True)
class _Result:
    path: Path
    verdict: dict[str, Any]
    failed: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.path.parent.name}/{self.path.stem}"

    @property
    def note(self) -> str:
        return (
            "error"
            if "error" in self.verdict
            else "does not hold"
            if self.failed
            else ""
        )


def verify(
    record: Annotated[
        list[Path], Argument(help="Records, or folders: all records in them.")
    ],
    asked: VerifyOptions,
    root: DataOption = None,
    jobs: JobsOption = 0,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again. Status 1 if one does not hold."""
    asked.require_together()
    trust = trusted(asked.base)
    seals = {} if asked.hidden is None else open_seals(asked.hidden, trust.listed)
    options = RunOptions(root, workers=WorkerChoice(jobs).workers())
    folders = [record_paths(path) if path.is_dir() else [path] for path in record]
    paths = list(dict.fromkeys(path for folder in folders for path in folder))
    if not paths:
        raise RecordError(
            f"{record[0]}: no record there, expected files <submission>/<env id>.json"
        )
    if asked.sign is not None:
        trust.require_signer(asked.sign, asked.signer or "")
        trust.require_listed(seals.values())
    with ExitStack() as ends:  # hidden scenes are made once for all records
        every = Round(asked.rerun, seals, asked.submission, asked.made_here)
        check = partial(
            _checked, asked=asked, every=every, trust=trust, options=options, ends=ends
        )
        results = [_check_one(path, check, alone=record == [path]) for path in paths]
    if len(results) > 1:
        show_table(_summary(results))
    write_json(json_file, {"records": [result.verdict for result in results]})
    failed = [result.failed for result in results if result.failed]
    if failed:
        raise RecordError(some_of(failed))


def _check_one(path: Path, check: Callable[[Path], _Result], alone: bool) -> _Result:
    """Check one record; an error of one among several does not stop the others."""
    start = time.monotonic()
    try:
        result = check(path)
    except (MtpBenchError, OSError) as error:
        if alone:
            raise
        result = _Result(
            path, {"record": str(path), "error": said_of(error)}, said_of(error)
        )
    return replace(result, seconds=time.monotonic() - start)


def _checked(
    path: Path,
    asked: VerifyOptions,
    every: Round,
    trust: Trust,
    options: RunOptions,
    ends: ExitStack,
) -> _Result:
    record = checked_record(path)
    done = (
        every.reached(path, record, trust)
        if asked.sign is not None and not asked.looked_at
        else None
    )
    if done is not None:
        said = done.statement
        show(f"{path}: {said.level} since {said.date}, signed by {done.signer}")
        known = {
            "record": str(path),
            "digest": record.digest,
            "holds": True,
            "level": said.level,
        }
        return _Result(path, {**known, **_on_hidden_scenes(said.hidden)})
    with working(
        f"verifying {record.submission.name} on {record.env.id}", options
    ) as watched:
        checked = every.verify(path, record, watched, asked.env, ends)
    if checked.differences:
        _show_differences(checked)
    show(_verdict(checked))
    if asked.sign is not None and checked.holds:
        attest(checked, asked.sign, asked.signer or "", trust, asked.looked_at)
        show(f"{path}: {checked.level}, signed by {asked.signer}")
    differ = f"{path}: {counted(len(checked.differences), 'difference')} to what was found here"
    return _Result(path, _as_json(checked), "" if checked.holds else differ)


def _show_differences(checked: Verification) -> None:
    shown = checked.differences[:MOST_DIFFERENCES]
    cut = [
        {
            key: clean_text(str(value), MOST_LETTERS)
            for key, value in each._asdict().items()
        }
        for each in shown
    ]
    columns = [Column(key=key) for key in Difference._fields]
    show_table(Table("differences", f"{checked.path}: differences", "", cut, columns))
    more = len(checked.differences) - len(shown)
    show_lines([f"and {more} more"] if more else [])


def _summary(results: Sequence[_Result]) -> Table:
    columns = (
        Column("record", key="name"),
        Column(key="level", read=lambda result: result.verdict.get("level")),
        Column(
            key="on hidden scenes",
            read=lambda result: result.verdict.get("hidden_number"),
        ),
        Column(key="minutes", format=".1f", read=lambda result: result.seconds / 60),
        Column(key="note"),
    )
    return Table("records", "records", "", results, columns)


def _on_hidden_scenes(hidden: HiddenPart | None) -> dict[str, Any]:
    if hidden is None:
        return {"hidden_error": None, "hidden_number": None}
    error, driving = (
        hidden.row.error,
        hidden.driving,
    )  # in a closed loop the error is 1 minus the drive score
    number = (
        f"error {short(error)} m"
        if driving is None
        else f"drive score {driving.drive_score:.3f}"
    )
    return {"hidden_error": error, "hidden_number": number}


def _as_json(checked: Verification) -> dict[str, Any]:
    return {
        "record": str(checked.path),
        "digest": checked.record.digest,
        "holds": checked.holds,
        "level": checked.level,
        **_on_hidden_scenes(checked.hidden),
        "differences": [difference._asdict() for difference in checked.differences],
        "notes": list(checked.notes),
    }


def _verdict(checked: Verification) -> str:
    record, hidden = checked.record, checked.hidden
    subject = f"{checked.path}: {record.submission.name} on {record.env.id}"
    sentences = [
        f"{subject}: holds, {checked.level}"
        if checked.holds
        else f"{subject}: does not hold"
    ]
    if hidden is not None:
        few = (
            ""
            if hidden.scenes >= LEAST_HIDDEN
            else f", too few to rank: ranks need {LEAST_HIDDEN}"
        )
        number = _on_hidden_scenes(hidden)["hidden_number"]
        sentences.append(f"{number} on {counted(hidden.scenes, 'hidden scene')}{few}")
    return ". ".join([*sentences, *checked.notes])
