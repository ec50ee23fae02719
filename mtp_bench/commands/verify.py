"""``mtp-bench verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import MtpBenchError, RecordError
from .options import DataOption, JobsOption, JsonOption, WorkerChoice
from .output import count, number, require_writable, working, write_json

if TYPE_CHECKING:
    from rich.table import Table

    from ..records.verifying import Verification

MOST_DIFFERENCES = 20  # shown per record
MOST_LETTERS = 60  # of a value in the table


def verify(
    record: Annotated[Path, typer.Argument(help="A record, or a folder: all records in it.")],
    root: DataOption = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Run the submission again, also under a secret seed.")] = False,
    submission: Annotated[
        Path | None, typer.Option(help="Folder to run again; else the baseline of that name.")
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Take over today's numbers where scorer or weights changed.")
    ] = False,
    hidden: Annotated[
        Path | None, typer.Option(help="Secret of `mtp-bench seal`: with --rerun, run its scenes too.")
    ] = None,
    commitment: Annotated[
        Path | None, typer.Option(help="What the secret was promised with; the file beside it.")
    ] = None,
    jobs: JobsOption = 0,
    env: Annotated[str | None, typer.Option(help="Card of the record, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again. Status 1 where one does not hold."""
    from ..records import open_seal, record_paths
    from ..records import verify as check_record
    from ..records.verifying import confirm
    from ..running.options import RunOptions
    from ..viz.terminal.output import show, show_numbers

    _require_together(rerun, submission, hidden, commitment)
    require_writable(json_file)
    paths = record_paths(record) if record.is_dir() else [record]
    if not paths:
        raise RecordError(f"{record}: no record there, expected files <submission>/<env id>.json")
    sealed = None if hidden is None else open_seal(hidden, commitment)
    options = RunOptions(root, workers=WorkerChoice(jobs).workers())
    failed, verdicts = [], []
    for file in paths:
        try:
            with working(f"verify {file.name}", options) as watched:
                checked = check_record(file, watched, env, submission, rerun, sealed)
        except MtpBenchError as error:
            if not record.is_dir():
                raise
            failed.append(str(error))
            verdicts.append({"record": str(file), "error": str(error)})
            continue
        verdicts.append(_as_json(checked))
        if checked.differences:
            show_numbers(_difference_table(checked))
        show(_verdict(checked))
        if write and checked.updated is not None:
            show(f"{file}: written with the digest {confirm(checked).digest[:12]}")
        elif not checked.holds:
            failed.append(f"{file}: {count(len(checked.differences), 'difference')} to what was found here")
    write_json(json_file, {"records": verdicts})
    if failed:
        raise RecordError("; ".join(failed))


def _require_together(rerun: bool, submission: Path | None, hidden: Path | None, commitment: Path | None) -> None:
    """Wrong usage for an option without the one that it belongs to."""
    for given, needed, option, text in (
        (submission, rerun, "--submission", "is for running it again: add --rerun"),
        (hidden, rerun, "--hidden", "is for running the submission: add --rerun"),
        (commitment, hidden, "--commitment", "belongs to a secret: name it with --hidden"),
    ):
        if given is not None and not needed:
            raise typer.BadParameter(text, param_hint=option)


def _difference_table(checked: Verification) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{checked.path}: what differs"))
    for name in ("what", "recorded", "found"):
        table.add_column(name, overflow="fold")
    for difference in checked.differences[:MOST_DIFFERENCES]:
        texts = [str(value) for value in difference]
        short = [text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 3]}..." for text in texts]
        table.add_row(*map(escape, short))
    hidden = len(checked.differences) - MOST_DIFFERENCES
    if hidden > 0:
        table.add_row(f"and {hidden} more", "", "")
    return table


def _as_json(checked: Verification) -> dict[str, Any]:
    differences = [difference._asdict() for difference in checked.differences]
    verdict = {"record": str(checked.path), "digest": checked.record.digest, "holds": checked.holds}
    return {**verdict, "level": checked.level, "differences": differences, "notes": list(checked.notes)}


def _verdict(checked: Verification) -> str:
    record = checked.record
    who = f"{checked.path}: {record.submission.name} on {record.env.id}"
    what = f"holds, {checked.level}" if checked.holds else "does not hold"
    hidden = []
    if checked.hidden is not None:
        hidden.append(f"error {number(checked.hidden.error)} m on {count(checked.hidden.scenes, 'hidden scene')}")
    return ". ".join([f"{who}: {what}", *hidden, *checked.notes])
