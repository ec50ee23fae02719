"""``mtp-bench board``: records with their ranks, as tables, as a page and as files."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from typer import Option

from ..cards import load_card
from ..core import MtpBenchError, Progress, RecordError, bundled, long_work
from ..judge import (
    RECORDS,
    Record,
    Trust,
    load_record,
    read_level,
    record_paths,
    trusted,
)
from ..scoring import SUBSETS, Subset
from ..viz import (
    Entry,
    LinkedRecord,
    Pages,
    board_files,
    board_json,
    board_table,
    board_tables,
    counted,
    entries_of,
    is_baseline,
    parts_folder,
    require_parts,
    show,
    show_lines,
    show_table,
    write_board,
)
from .options import BaseOption, JsonOption, TableOption, file_option
from .output import write_json, write_table


def board(
    further: Annotated[
        list[Path] | None,
        Option("--with", help="A record to place among the others; repeatable."),
    ] = None,
    records: Annotated[
        Path | None, Option(help="Folder of records; leaderboard/records by default.")
    ] = None,
    output: Annotated[
        Path | None,
        file_option(
            "-o",
            "--output",
            text="Also write a page (.html) with its parts beside it.",
            suffixes=(".html",),
        ),
    ] = None,
    env: Annotated[str | None, Option(help="Only this environment.")] = None,
    base: BaseOption = None,
    strict: Annotated[
        bool, Option("--strict", help="Status 1 where a record is broken.")
    ] = False,
    table_file: TableOption = None,
    json_file: JsonOption = None,
) -> None:
    """Show the leaderboard: a table per environment, and a page to open in a browser."""
    if output is not None:
        require_parts(output)
    with long_work("reading records") as progress:
        subsets: Sequence[Subset] = (
            ("all",) if output is None else SUBSETS
        )  # tables show no other
        entries, refused, notes = read_board(
            records, further or (), env, output, trusted(base), progress, subsets
        )
    tables = board_tables(entries)
    if json_file is not None:
        write_json(json_file, board_json(entries))
    write_table(
        table_file,
        [table for table, _ in tables],
        board_table(entries, env or "leaderboard"),
    )
    for table, below in tables:
        show_table(
            table,
            style=lambda entry: (
                "bold green" if entry.added else "" if entry.compared else "dim"
            ),
        )
        show("")
        show_lines(below)
    show_lines([*notes, *(f"refused: {text}" for text in refused)])
    if not entries:
        show(
            "no record"
            + (f" of {env}" if env else "")
            + " yet; `mtp-bench submit` makes one"
        )
    if output is not None:
        leaderboard = _folder(records).absolute().parent
        pages = (
            leaderboard / "SUBMITTING.md",
            leaderboard.parent / "docs" / "definitions" / "index.md",
        )
        addresses = Pages(*(_link(page, output) for page in pages))
        write_board(output, board_files(entries, parts_folder(output).name, addresses))
        show(f"{output}: {counted(len(entries), 'record')}; open it in a browser")
    if strict and refused:
        raise RecordError(
            f"{counted(len(refused), 'record')} refused, the first: {refused[0]}"
        )


def read_board(
    folder: Path | None,
    further: Sequence[Path],
    env: str | None,
    page: Path | None,
    trust: Trust,
    progress: Progress,
    subsets: Sequence[Subset] = SUBSETS,
) -> tuple[list[Entry], list[str], list[str]]:
    """Entries in the order of the leaderboard, why records are broken, and notes on levels that are not shown.

    Those of ``further`` that are not in the folder are marked as added. They take the place of the folder's record of
    that submission, environment and split, as the files would. Of copies of one record the first with a signed level
    is taken; a note names the others. Of one environment only its own files are read: a record is named after its
    environment.

    ``page`` is the file that links start from; without one there are no links. A broken record of the folder is refused
    and stops no other. Raises MtpBenchError where the folder is missing, RecordError where a record of ``further`` is
    broken, UnknownNameError for an env without a record that is not a card either.
    """
    folder = _folder(folder)
    if not folder.is_dir():
        raise MtpBenchError(
            f"{folder}: no such folder of records; name one with --records: a checkout has it"
        )
    baselines = folder.absolute().parent.parent / "baselines"

    def read(path: Path, added: bool) -> LinkedRecord:
        record = load_record(path)
        if (
            not added and path.stem != record.env.id
        ):  # else its table would depend on --env
            raise RecordError(
                f"{path}: holds a record on {record.env.id}, expected {path.stem}: rename the file"
            )
        signed, note = read_level(path, record, trust)
        code = baselines / record.submission.name if is_baseline(record) else None
        return LinkedRecord(record, signed, _link(path, page), added, note, _link(code, page))

    given = [read(path, added=True) for path in further]  # before the long work
    refused: list[str] = []
    stored: list[tuple[Path, LinkedRecord]] = []
    paths = record_paths(folder, env or "")
    progress.started(len(paths))
    for path in paths:
        try:
            stored.append((path, read(path, added=False)))
        except RecordError as error:
            refused.append(str(error))
        progress.done(path.parent.name)
    found: dict[str, LinkedRecord] = {}
    files: dict[str, Path] = {}
    notes = []
    for path, each in sorted(stored, key=lambda pair: pair[1].signed is None):
        taken = files.setdefault(each.record.digest, path)
        if taken == path:
            found[each.record.digest] = each
        else:
            notes.append(f"{path}: a copy of {taken}, which is shown")
    for each in given:
        other = found.get(each.record.digest)
        if other is None or (each.signed is not None and other.signed is None):
            place = _place(each.record)
            found = {
                digest: other
                for digest, other in found.items()
                if _place(other.record) != place
            }
            found[each.record.digest] = each
    listed = [
        each for each in found.values() if env is None or each.record.env.id == env
    ]
    if env is not None and not listed:
        load_card(
            env
        )  # an env without a submission is fine as long as there is such an env
    notes += [
        f"{each.record.submission.name} on {each.record.env.id}: {each.note}"
        for each in listed
        if each.note
    ]
    return entries_of(listed, subsets), refused, notes


def _folder(given: Path | None) -> Path:
    ships = (
        bundled("leaderboard") / "records"
    )  # of the checkout: an installed wheel has none
    return given or (ships if ships.is_dir() else RECORDS)


def _place(record: Record) -> tuple[str, ...]:
    """The parts of the file name of a record in the folder of all."""
    return record.submission.name, record.env.id, record.env.split


def _link(path: Path | None, page: Path | None) -> str | None:
    """Relative address of a file or folder; None without a page, and where the file is missing."""
    if path is None or page is None or not path.exists():
        return None
    try:
        return Path(os.path.relpath(path.absolute(), page.absolute().parent)).as_posix()
    except ValueError:  # on another drive
        return None
