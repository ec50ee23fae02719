"""``mtp-bench board``: records with their ranks, as tables, as a page and as files."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from typer import Option

from ..cards import load_card
from ..core import MtpBenchError, Progress, RecordError, Table, bundled, long_work
from ..judge import (
    RECORDS,
    Record,
    Trust,
    is_baseline,
    load_record,
    read_file_entries,
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
    added_records: Annotated[
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
    subsets: Sequence[Subset] = ("all",)  # tables show no other
    if output is not None:
        require_parts(output)
        subsets = SUBSETS
    added_paths = added_records or ()
    with long_work("reading records") as progress:
        entries, refused, notes = read_board(
            records, added_paths, env, output, trusted(base), progress, subsets
        )
    tables = board_tables(entries)
    if json_file is not None:
        write_json(json_file, board_json(entries))
    data_table = board_table(entries, env or "leaderboard")
    write_table(table_file, [table for table, _ in tables], data_table)
    _show_tables(tables, env)
    show_lines([*notes, *(f"refused: {reason}" for reason in refused)])
    if output is not None:
        _write_page(output, _records_folder(records), entries)
    if strict and refused:
        raise RecordError(
            f"{counted(len(refused), 'record')} refused, the first: {refused[0]}"
        )


def _show_tables(tables: Sequence[tuple[Table, list[str]]], env: str | None) -> None:
    for table, lines_below in tables:
        show_table(table, style=_row_style)
        show("")
        show_lines(lines_below)
    if not tables:
        place = f" of {env}" if env else ""
        show(f"no record{place} yet; `mtp-bench submit` makes one")


def _row_style(entry: Entry) -> str:
    if entry.added:
        return "bold green"
    return "" if entry.compared else "dim"


def _write_page(output: Path, folder: Path, entries: Sequence[Entry]) -> None:
    leaderboard = folder.absolute().parent
    submitting = leaderboard / "SUBMITTING.md"
    definitions = leaderboard.parent / "docs" / "definitions" / "index.md"
    addresses = Pages(_link(submitting, output), _link(definitions, output))
    file_entries = read_file_entries(leaderboard / "files")
    parts_name = parts_folder(output).name
    write_board(output, board_files(entries, parts_name, addresses, file_entries))
    show(f"{output}: {counted(len(entries), 'record')}; open it in a browser")


def read_board(
    folder: Path | None,
    added_paths: Sequence[Path],
    env: str | None,
    page: Path | None,
    trust: Trust,
    progress: Progress,
    subsets: Sequence[Subset] = SUBSETS,
) -> tuple[list[Entry], list[str], list[str]]:
    """Read entries in the order of the leaderboard, refusals and notes.

    Refusals say why records are broken, notes which levels are not shown. Records of
    ``added_paths`` that are not in the folder are marked as added. They take the place
    of the folder's record of that submission, environment and split, as the files
    would. Of copies of one record the first with a signed level is shown, and a note
    names the others. Of one environment only its own files are read: a record is named
    after its environment.

    ``page`` is the file that links start from; without one there are no links. A broken
    record of the folder is refused and stops no other. Raises MtpBenchError where the
    folder is missing, RecordError where a record of ``added_paths`` is broken,
    UnknownNameError for an env without a record that is not a card either.
    """
    folder = _records_folder(folder)
    baselines = folder.absolute().parent.parent / "baselines"

    def read(path: Path, added: bool) -> LinkedRecord:
        record = load_record(path)
        # else its table would depend on --env
        if not added and path.stem != record.env.id:
            raise RecordError(
                f"{path}: holds a record on {record.env.id}, expected {path.stem}: "
                "rename the file"
            )
        signed, note = read_level(path, record, trust)
        code = baselines / record.submission.name if is_baseline(record) else None
        return LinkedRecord(
            record, signed, _link(path, page), added, note, _link(code, page)
        )

    added_records = [read(path, added=True) for path in added_paths]
    refused: list[str] = []
    stored: dict[Path, LinkedRecord] = {}
    paths = record_paths(folder, env or "")
    progress.started(len(paths))
    for path in paths:
        try:
            stored[path] = read(path, added=False)
        except RecordError as error:
            refused.append(str(error))
        progress.done(path.parent.name)
    shown, notes = _without_copies(stored)
    for record in added_records:
        shown = _with_added(shown, record)
    listed = [entry for entry in shown.values() if env in (None, entry.record.env.id)]
    if env is not None and not listed:
        load_card(env)  # no record is fine, as long as there is such an env
    return entries_of(listed, subsets), refused, notes + _level_notes(listed)


def _level_notes(listed: Sequence[LinkedRecord]) -> list[str]:
    """Return why signed levels are not shown."""
    notes = []
    for entry in listed:
        if entry.note:
            record_name = f"{entry.record.submission.name} on {entry.record.env.id}"
            notes.append(f"{record_name}: {entry.note}")
    return notes


def _without_copies(
    stored: Mapping[Path, LinkedRecord],
) -> tuple[dict[str, LinkedRecord], list[str]]:
    """Return a record per digest, preferably with a signed level, and notes."""
    shown: dict[str, LinkedRecord] = {}
    shown_paths: dict[str, Path] = {}
    notes = []
    for path in sorted(stored, key=lambda path: stored[path].signed is None):
        digest = stored[path].record.digest
        if digest in shown:
            notes.append(f"{path}: a copy of {shown_paths[digest]}, which is shown")
        else:
            shown[digest] = stored[path]
            shown_paths[digest] = path
    return shown, notes


def _with_added(
    shown: dict[str, LinkedRecord], added: LinkedRecord
) -> dict[str, LinkedRecord]:
    """Return the shown records with an added one in its place."""
    copy = shown.get(added.record.digest)
    if copy is not None and (added.signed is None or copy.signed is not None):
        return shown
    place = _place(added.record)
    remaining: dict[str, LinkedRecord] = {}
    for digest, entry in shown.items():
        if _place(entry.record) != place:
            remaining[digest] = entry
    return {**remaining, added.record.digest: added}


def _records_folder(folder: Path | None) -> Path:
    """Return the folder of records.

    Raises MtpBenchError where it is missing.
    """
    if folder is None:
        folder = bundled("leaderboard") / "records"
        if not folder.is_dir():  # an installed wheel has none
            folder = RECORDS
    if not folder.is_dir():
        raise MtpBenchError(
            f"{folder}: no such folder of records; name one with --records: "
            "a checkout has it"
        )
    return folder


def _place(record: Record) -> tuple[str, ...]:
    """Return the parts of a record's file name in the folder of all."""
    return record.submission.name, record.env.id, record.env.split


def _link(path: Path | None, page: Path | None) -> str | None:
    """Return the relative address of a file or folder.

    None without a page, and where the file is missing.
    """
    if path is None or page is None or not path.exists():
        return None
    try:
        return Path(os.path.relpath(path.absolute(), page.absolute().parent)).as_posix()
    except ValueError:  # on another drive
        return None
