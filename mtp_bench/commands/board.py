"""``mtp-bench board``: records with their ranks, as tables, as a page and as JSON."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import MtpBenchError
from .options import JsonOption
from .output import count, require_writable, write_json

if TYPE_CHECKING:
    from ..viz.board.entries import Entry


def board(
    further: Annotated[
        list[Path] | None, typer.Option("--with", help="A record to place among the others; repeatable.")
    ] = None,
    records: Annotated[Path | None, typer.Option(help="Folder of records; those that ship by default.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Also write a page that needs no network: a .html file.")
    ] = None,
    env: Annotated[str | None, typer.Option(help="Only this environment.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Show the leaderboard: a table per environment, and a page to open in a browser."""
    from .._bundle import bundled
    from ..files import write_text
    from ..records import read_history
    from ..viz.board import board_json, board_notes, board_page, board_tables
    from ..viz.terminal.output import show, show_lines, show_numbers

    require_writable(json_file, output)
    entries = read_board(records, further or (), env, output)
    folder = records or bundled("leaderboard") / "records"
    history = [old for old in read_history(folder.parent / "history") if env in (None, old.env)]
    write_json(json_file, board_json(entries))
    if output is not None:
        links = [relative_address(old.path, output) for old in history]
        write_text(output, board_page(entries, list(zip(history, links, strict=True))))
    for table, notes in zip(board_tables(entries), board_notes(entries), strict=True):
        show_numbers(table)
        show("")
        show_lines(notes)
    if not entries:
        show("no record" + (f" of {env}" if env else "") + " yet; `mtp-bench submit` makes one")
    if history:
        show(f"{count(len(history), 'result')} under earlier definitions: on the page (-o), never ranked")
    if output is not None:
        show(f"{output}: {count(len(entries), 'record')}; open it in a browser")


def read_board(
    folder: Path | None, further: Sequence[Path], env_id: str | None, page: Path | None = None
) -> list[Entry]:
    """Entries in the order of the leaderboard; those of ``further`` that are not in the folder are marked as added.

    ``page`` is the file that links start from; without one there are none. Raises MtpBenchError where the folder is
    missing, RecordError where a record is broken, UnknownNameError for an env without a record that is no card either.
    """
    from .._bundle import bundled
    from ..cards import load_card
    from ..records import load_record, record_paths
    from ..viz.board import entries_of

    if folder is not None and not folder.is_dir():
        raise MtpBenchError(f"{folder}: no such folder of records; name another with --records")
    paths = record_paths(folder or bundled("leaderboard") / "records")  # there are none yet where it is missing
    found = {record.digest: (record, path, False) for path in paths for record in [load_record(path)]}
    for path in further:
        record = load_record(path)
        found.setdefault(record.digest, (record, path, True))
    listed = [item for item in found.values() if env_id is None or item[0].env.id == env_id]
    if env_id is not None and not listed:
        load_card(env_id)  # an env that nobody has submitted to is fine as long as there is such an env
    return entries_of(
        [(record, None if page is None else relative_address(path, page), added) for record, path, added in listed]
    )


def relative_address(path: Path, page: Path) -> str | None:
    """Way from the folder of ``page`` to ``path``; None from another drive."""
    try:
        relative = os.path.relpath(path.absolute(), page.absolute().parent)
    except ValueError:
        return None
    return Path(relative).as_posix()
