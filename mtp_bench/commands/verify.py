"""``mtp-bench verify``."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from ..core import (
    Column,
    MtpBenchError,
    RecordError,
    Table,
    clean_text,
    long_work,
    short,
)
from ..judge import (
    LEAST_HIDDEN,
    Difference,
    HiddenPart,
    Record,
    Sealed,
    SignedLevel,
    Trust,
    Verification,
    attest,
    checked_record,
    level_reached,
    open_seals,
    record_paths,
    submission_of,
    trusted,
    verify as check_record,
)
from ..running import RunOptions
from ..viz import counted, show, show_lines, show_table
from .options import BaseOption, DataOption, JobsOption, JsonOption, WorkerChoice
from .output import error_text, some_of, write_json

_MAX_DIFFERENCES = 20  # shown per record
_MAX_LETTERS = 60  # of a value in the table


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
            help="Submission to run again, or a folder of them by name; "
            "else the baseline of that name."
        ),
    ] = None
    made_here: Annotated[
        bool,
        Option(
            "--made-here",
            help="You made these records of baselines: do not repeat their public "
            "runs.",
        ),
    ] = False
    hidden: Annotated[
        Path | None,
        Option(
            help="Secret of `maintain seal`, or a folder of them: with --rerun, run "
            "its scenes."
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
        needs = {
            "submission": "rerun",
            "hidden": "rerun",
            "made_here": "rerun",
            "sign": "signer",
            "signer": "sign",
            "looked_at": "sign",
        }
        for option_name, needed_option in needs.items():
            if getattr(self, option_name) and not getattr(self, needed_option):
                option = f"--{option_name.replace('_', '-')}"
                raise BadParameter(f"needs --{needed_option}", param_hint=option)


@dataclass(frozen=True)
class _Result:
    path: Path
    verdict: dict[str, Any]
    failure: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.path.parent.name}/{self.path.stem}"

    @property
    def note(self) -> str:
        if "error" in self.verdict:
            return "error"
        return "does not hold" if self.failure else ""


def verify(
    record: Annotated[
        list[Path], Argument(help="Records, or folders: all records in them.")
    ],
    checks: VerifyOptions,
    root: DataOption = None,
    jobs: JobsOption = 0,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again.

    Status 1 if one does not hold.
    """
    checks.require_together()
    trust = trusted(checks.base)
    seals = {} if checks.hidden is None else open_seals(checks.hidden, trust.listed)
    options = RunOptions(root, workers=WorkerChoice(jobs).workers())
    paths = _record_files(record)
    if checks.sign is not None:
        trust.require_signer(checks.sign, checks.signer or "")
        trust.require_listed(seals.values())
    with ExitStack() as ends:  # hidden scenes are made once for all records
        check = partial(
            _checked,
            checks=checks,
            seals=seals,
            trust=trust,
            options=options,
            ends=ends,
        )
        is_single = len(paths) == 1 and record == paths  # a file, not a folder
        results = [_check_one(path, check, is_single) for path in paths]
    if len(results) > 1:
        show_table(_summary(results))
    write_json(json_file, {"records": [result.verdict for result in results]})
    failures = list(filter(None, (result.failure for result in results)))
    if failures:
        raise RecordError(some_of(failures))


def _record_files(arguments: Sequence[Path]) -> list[Path]:
    """Return the records and those of folders, each once.

    Raises RecordError.
    """
    paths: dict[Path, None] = {}
    for argument in arguments:
        files = record_paths(argument) if argument.is_dir() else [argument]
        paths |= dict.fromkeys(files)
    if not paths:
        raise RecordError(
            f"{arguments[0]}: no record there, "
            "expected files <submission>/<env id>.json"
        )
    return list(paths)


def _check_one(
    path: Path, check: Callable[[Path], _Result], is_single: bool
) -> _Result:
    """Call ``check`` on one record, and note the time and an error.

    An error of one among several does not stop the others.
    """
    begin = time.monotonic()
    try:
        result = check(path)
    except (MtpBenchError, OSError) as error:
        if is_single:
            raise
        text = error_text(error)
        result = _Result(path, {"record": str(path), "error": text}, text)
    return replace(result, seconds=time.monotonic() - begin)


def _checked(
    path: Path,
    checks: VerifyOptions,
    seals: Mapping[str, Sealed],
    trust: Trust,
    options: RunOptions,
    ends: ExitStack,
) -> _Result:
    """Check one record, show the outcome, and sign the level if a key is given."""
    record = checked_record(path)
    sealed = seals.get(record.env.id)
    if checks.sign is not None and not checks.looked_at:
        signed = level_reached(path, record, trust, checks.rerun, sealed)
        if signed is not None:
            return _signed_before(path, record, signed)
    title = f"verifying {record.submission.name} on {record.env.id}"
    with long_work(title) as progress:
        options = replace(options, progress=progress)
        checked = check_record(
            path,
            options,
            checks.env,
            submission=submission_of(record, checks.submission),
            rerun=checks.rerun,
            sealed=sealed,
            ends=ends,
            made_here=checks.made_here,
        )
    if checked.differences:
        _show_differences(checked)
    show(_verdict(checked))
    if checks.sign is not None and checked.holds:
        attest(checked, checks.sign, checks.signer or "", trust, checks.looked_at)
        show(f"{path}: {checked.level}, signed by {checks.signer}")
    failure = ""
    if not checked.holds:
        differences = counted(len(checked.differences), "difference")
        failure = f"{path}: {differences} to what was found here"
    return _Result(path, _as_json(checked), failure)


def _signed_before(path: Path, record: Record, signed: SignedLevel) -> _Result:
    """Show the level that was signed for a record before."""
    statement = signed.statement
    show(f"{path}: {statement.level} since {statement.date}, signed by {signed.signer}")
    reached = Verification(path, record, statement.level, hidden=statement.hidden)
    return _Result(path, _as_json(reached))


def _show_differences(checked: Verification) -> None:
    rows = []
    for difference in checked.differences[:_MAX_DIFFERENCES]:
        row = {}
        for name, value in difference._asdict().items():
            row[name] = clean_text(str(value), _MAX_LETTERS)
        rows.append(row)
    columns = [Column(key=key) for key in Difference._fields]
    show_table(Table("differences", f"{checked.path}: differences", "", rows, columns))
    omitted_count = len(checked.differences) - len(rows)
    if omitted_count:
        show_lines([f"and {omitted_count} more"])


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
    """Return the error on hidden scenes, and the number that ranks as text.

    In a closed loop the error is 1 minus the drive score.
    """
    if hidden is None:
        return {"hidden_error": None, "hidden_number": None}
    error = hidden.row.error
    number = f"error {short(error)} m"
    if hidden.driving is not None:
        number = f"drive score {hidden.driving.drive_score:.3f}"
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
    subject = f"{checked.path}: {checked.record.submission.name} on "
    subject += checked.record.env.id
    sentences = [f"{subject}: does not hold"]
    if checked.holds:
        sentences = [f"{subject}: holds, {checked.level}"]
    hidden = checked.hidden
    if hidden is not None:
        number = _on_hidden_scenes(hidden)["hidden_number"]
        sentence = f"{number} on {counted(hidden.scenes, 'hidden scene')}"
        if hidden.scenes < LEAST_HIDDEN:
            sentence += f", too few to rank: ranks need {LEAST_HIDDEN}"
        sentences.append(sentence)
    return ". ".join([*sentences, *checked.notes])
