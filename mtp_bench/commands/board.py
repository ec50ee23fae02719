"""``mtp-bench board``: records with their ranks, as tables, as a page and as JSON."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .._bundle import baseline_names
from ..errors import MtpBenchError, RecordError
from ..parallel import Progress
from .options import JsonOption
from .output import require_writable, write_json

if TYPE_CHECKING:
    from ..records import Record, Trust
    from ..viz.board.entries import Entry, Found


@dataclass(frozen=True)
class Board:
    """What is shown, and what was not taken."""

    entries: list[Entry]
    refused: list[str]  # records that are broken, each with its reason
    notes: list[str]  # levels that are not shown


def board(
    further: Annotated[
        list[Path] | None, typer.Option("--with", help="A record to place among the others; repeatable.")
    ] = None,
    records: Annotated[Path | None, typer.Option(help="Folder of records; those that ship by default.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Also write a page (.html) with its parts beside it.")
    ] = None,
    env: Annotated[str | None, typer.Option(help="Only this environment.")] = None,
    pages: Annotated[
        list[Path] | None,
        typer.Option("--fill", help="A Markdown page whose figures are of the records: fill them in; repeatable."),
    ] = None,
    base: Annotated[
        Path | None, typer.Option(help="Leaderboard whose keys and seals are trusted. Default: the one that ships.")
    ] = None,
    clips: Annotated[
        bool, typer.Option("--clips", help="First draw the costliest event of simulated records with stored rollouts.")
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Status 1 where a record is broken.")] = False,
    json_file: JsonOption = None,
) -> None:
    """Show the leaderboard: a table per environment, and a page to open in a browser."""
    from ..records import read_history, trusted
    from ..records.packed import shipped_records
    from ..viz.board import board_files, board_json, board_tables, parts_folder, require_parts, write_board
    from ..viz.terminal.output import counted, progress_bar, show, show_lines, show_numbers

    require_writable(json_file, output)
    if output is not None:
        if output.suffix != ".html":
            raise typer.BadParameter(f"{output}: expected a name that ends in .html", param_hint="--output")
        require_parts(output)
    folder = records or shipped_records()
    if clips:
        _draw_clips(folder, env)
    with progress_bar("records") as progress:
        found = read_board(records, further or (), env, output, trusted(base), progress)
    entries = found.entries
    history = [old for old in read_history(folder.parent / "history") if env in (None, old.env)]
    told = _fill(pages, found, folder.parent, whole=not (env or further)) if pages else []
    write_json(json_file, board_json(entries))
    if output is not None:
        old_results = [(old, relative_address(old.path, output)) for old in history]
        submitting = folder.parent / "SUBMITTING.md"
        guide = relative_address(submitting, output) if submitting.exists() else None
        write_board(output, board_files(entries, old_results, parts_folder(output).name, guide))
    for table, notes in board_tables(entries):
        show_numbers(table)
        show("")
        show_lines(notes)
    show_lines([*found.notes, *(f"refused: {text}" for text in found.refused)])
    if not entries:
        show("no record" + (f" of {env}" if env else "") + " yet; `mtp-bench submit` makes one")
    if history:
        show(f"{counted(len(history), 'result')} under earlier definitions: on the page (-o), never ranked")
    if output is not None:
        show(f"{output}: {counted(len(entries), 'record')}; open it in a browser")
    show_lines(told)
    if strict and found.refused:
        raise RecordError(f"{counted(len(found.refused), 'record')} refused, the first: {found.refused[0]}")


def read_board(
    folder: Path | None,
    further: Sequence[Path],
    env_id: str | None,
    page: Path | None,
    trust: Trust,
    progress: Progress,
) -> Board:
    """Entries in the order of the leaderboard; those of ``further`` that are not in the folder are marked as added.

    They take the place of the folder's record of that submission, environment and split, as the files would.

    ``page`` is the file that links start from; without one there are none. A broken record of the folder is refused
    and stops no other. Raises MtpBenchError where the folder is missing, RecordError where a record of ``further`` is
    broken, UnknownNameError for an env without a record that is no card either.
    """
    from ..cards import load_card
    from ..records import record_paths
    from ..records.packed import shipped_records
    from ..viz.board import entries_of

    if folder is not None and not folder.is_dir():
        raise MtpBenchError(f"{folder}: no such folder of records; name another with --records")
    folder = folder or shipped_records()
    start = _Start(page, trust, folder.absolute().parent.parent / "baselines")
    refused: list[str] = []
    paths = record_paths(folder)
    progress.started(len(paths))
    found = {each.record.digest: each for each in _sound(paths, start, refused, progress)}
    for path in further:
        each = _read(path, start, added=True)
        if each.record.digest not in found:
            place = _place(each.record)
            found = {digest: other for digest, other in found.items() if _place(other.record) != place}
            found[each.record.digest] = each
    listed = [each for each in found.values() if env_id is None or each.record.env.id == env_id]
    if env_id is not None and not listed:
        load_card(env_id)  # an env that nobody has submitted to is fine as long as there is such an env
    notes = [f"{each.record.submission.name} on {each.record.env.id}: {each.note}" for each in listed if each.note]
    return Board(entries_of(listed), refused, notes)


def _place(record: Record) -> tuple[str, ...]:
    """What names the file of a record in the folder of all."""
    return record.submission.name, record.env.id, record.env.split


def _fill(pages: Sequence[Path], found: Board, leaderboard: Path, whole: bool) -> list[str]:
    """Fill in pages from all records: of a part of them a page would lose what it says of others. Lines to show."""
    from ..viz.results import fill, known_of
    from ..viz.terminal.output import counted

    if not whole:
        raise typer.BadParameter("needs all records and no others, leave --env and --with out", param_hint="--fill")
    if found.refused:
        raise RecordError(f"no page is filled in: {counted(len(found.refused), 'record')} refused, {found.refused[0]}")
    return fill(pages, known_of(found.entries), leaderboard)


def relative_address(path: Path, page: Path) -> str | None:
    """Way from the folder of ``page`` to ``path``; None from another drive."""
    try:
        relative = os.path.relpath(path.absolute(), page.absolute().parent)
    except ValueError:
        return None
    return Path(relative).as_posix()


@dataclass(frozen=True)
class _Start:
    """Where records are read for."""

    page: Path | None  # the file that links start from; None: there are none
    trust: Trust
    baselines: Path  # beside the leaderboard

    def link(self, path: Path) -> str | None:
        """Way from the page to a file or folder; None without a page, and where there is none."""
        return relative_address(path, self.page) if self.page is not None and path.exists() else None


def _sound(paths: Sequence[Path], start: _Start, refused: list[str], progress: Progress) -> Iterator[Found]:
    """The records that can be read; why not, of the others, goes to ``refused``."""
    for path in paths:
        try:
            yield _read(path, start, added=False)
        except RecordError as error:
            refused.append(str(error))
        progress.done(path.parent.name)


def _read(path: Path, start: _Start, added: bool) -> Found:
    from ..records import load_record, read_level
    from ..viz.board.clips import clip_path
    from ..viz.board.entries import Found

    record = load_record(path)
    signed, note = read_level(path, record, start.trust)
    code, clip = _code_of(record, start), start.link(clip_path(path, record))
    return Found(record, signed, start.link(path), added, note, code, clip)


def _draw_clips(folder: Path, env: str | None) -> None:
    """Write a clip beside each record that can have one and has not; a record that is broken has none."""
    from ..records import load_record, record_paths
    from ..viz.board.clips import can_have_clip, clip_path, write_clip
    from ..viz.terminal.output import progress_bar, show

    paths = record_paths(folder)
    with progress_bar("clips") as progress:
        progress.started(len(paths))
        for path in paths:
            try:
                record = load_record(path)
                wanted = env in (None, record.env.id) and can_have_clip(path, record)
                written = write_clip(path, record) if wanted and not clip_path(path, record).is_file() else None
                if written is not None:
                    show(str(written))
            except MtpBenchError as error:
                show(f"no clip: {error}")
            progress.done(path.stem)


def _code_of(record: Record, start: _Start) -> str | None:
    """Way to the folder of a baseline that ships; None for a submission of others, whatever its name."""
    from ..records.eligibility import why_not_genuine

    name = record.submission.name
    if start.page is None or name not in baseline_names() or why_not_genuine(record):
        return None
    return start.link(start.baselines / name)
