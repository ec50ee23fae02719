"""``mtp-bench board``: records with their ranks, as tables, as a page and as files."""

import os
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, astuple, replace
from functools import partial
from pathlib import Path
from shutil import which
from typing import Annotated, Any

from typer import Option

from ..cards import load_card
from ..core import (
    Column,
    MtpBenchError,
    Progress,
    RecordError,
    Table,
    bundled,
    file_stem,
    files_digest,
    kept,
    library_digest,
    long_work,
)
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
    BoardFiles,
    Entry,
    LinkedRecord,
    Pages,
    board_files,
    board_json,
    board_table,
    board_tables,
    counted,
    entries_of,
    env_order,
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
    folder = _records_folder(records)
    trust = trusted(base)
    subsets: Sequence[Subset] = ("all",)  # tables show no other
    if output is not None:
        require_parts(output)
        subsets = SUBSETS
    inputs = ""
    if not (added_records or json_file or table_file):
        inputs = _inputs(folder, output, trust)

    def made(progress: Progress, env_id: str | None) -> dict[str, Any]:
        entries, refused, notes = read_board(
            folder, added_records or (), env_id, output, trust, progress, subsets
        )
        tables = board_tables(entries)
        if json_file is not None:
            write_json(json_file, board_json(entries))
        if table_file is not None:
            data_table = board_table(entries, env_id or "leaderboard")
            write_table(table_file, [table for table, _ in tables], data_table)
        page = () if output is None else astuple(_page(output, folder, entries))
        stored = [_stored(*each) for each in tables]
        return {"tables": stored, "notes": notes, "refused": refused, "page": page}

    with long_work("reading records") as progress:
        shown = _kept(folder, env, output, inputs, partial(made, progress))
    tables, refused = shown["tables"], shown["refused"]
    _show_tables(tables, env)
    show_lines([*shown["notes"], *(f"refused: {reason}" for reason in refused)])
    if output is not None:
        write_board(output, BoardFiles(*shown["page"]))
        count = sum(len(table["rows"]) for table in tables)
        show(f"{output}: {counted(count, 'record')}; open it in a browser")
    if strict and refused:
        raise RecordError(
            f"{counted(len(refused), 'record')} refused, the first: {refused[0]}"
        )


def _kept(
    folder: Path,
    env: str | None,
    page: Path | None,
    inputs: str,
    make: Callable[[str | None], dict[str, Any]],
) -> dict[str, list[Any]]:
    """Return what is shown, of each environment from the cache if nothing changed.

    A page is kept as a whole. ``inputs``: see `_inputs`.
    """
    env_ids: list[str | None] = [env]
    kind = "board" if page is None else "page"
    if inputs and env is None and page is None:
        names = {path.stem for path in record_paths(folder)}
        env_ids = [*sorted(names, key=env_order)]
    shown: dict[str, list[Any]] = defaultdict(list)
    for env_id in env_ids:
        name = f"{kind}/{file_stem(env_id or 'all')}.json"
        key_of = partial(_key, folder, env_id, inputs)
        for part, items in kept(name, key_of, partial(make, env_id)).items():
            shown[part] += items
    return shown


def _key(folder: Path, env: str | None, inputs: str) -> str:
    """Return the key under which a board is kept, see `_inputs`."""
    with suppress(OSError):
        return inputs and inputs + files_digest(record_paths(folder, env or ""))
    return ""


def _inputs(folder: Path, page: Path | None, trust: Trust) -> str:
    """Return a text that changes with all but records that a board follows from.

    It is empty if time may change it, or a file cannot be read.
    """
    leaderboard = folder.absolute().parent
    files = [*leaderboard.glob("files/**/*"), *trust.seals.glob("*")]
    files += leaderboard.parent.glob("baselines/*")  # the page links to them
    # as `read_targets`, where records have a folder each or not
    for each in (*folder.absolute().parents[:2], bundled("leaderboard")):
        files += each.glob("targets/*")
    with suppress(OSError):
        digests = library_digest(), files_digest(sorted(files))
        links = page and page.absolute(), _addresses(folder, page)
        state = trust.state
        return state and repr((state, which("ssh-keygen"), folder, *digests, *links))
    return ""


def _addresses(folder: Path, page: Path | None) -> Pages:
    leaderboard = folder.absolute().parent
    definitions = leaderboard.parent / "docs" / "definitions" / "index.md"
    return Pages(_link(leaderboard / "SUBMITTING.md", page), _link(definitions, page))


def _page(output: Path, folder: Path, entries: Sequence[Entry]) -> BoardFiles:
    file_entries = read_file_entries(folder.absolute().parent / "files")
    parts_name = parts_folder(output).name
    return board_files(entries, parts_name, _addresses(folder, output), file_entries)


def _stored(table: Table, lines: Sequence[str]) -> dict[str, Any]:
    """Return a table and the lines below it as JSON, see `_show_tables`."""
    rows = []
    for record, entry in zip(table.records, table.rows, strict=True):
        rows.append({**record, "style": _row_style(entry)})
    columns = [asdict(replace(column, read=None)) for column in table.columns]
    return {"title": table.title, "rows": rows, "columns": columns, "lines": lines}


def _show_tables(tables: Sequence[Mapping[str, Any]], env: str | None) -> None:
    for stored in tables:
        columns = [Column(**fields) for fields in stored["columns"]]
        table = Table("", stored["title"], "", stored["rows"], columns)
        show_table(table, style=lambda row: str(row["style"]))
        show("")
        show_lines(stored["lines"])
    if not tables:
        if env is not None:
            load_card(env)  # no record is fine, as long as there is such an env
        place = f" of {env}" if env else ""
        show(f"no record{place} yet; `mtp-bench submit` makes one")


def _row_style(entry: Entry) -> str:
    if entry.added:
        return "bold green"
    return "" if entry.compared else "dim"


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
    folder is missing, RecordError where a record of ``added_paths`` is broken.
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
