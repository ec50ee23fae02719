"""Printing and writing, shared by the commands."""

import io
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

from ..core import (
    FULL_DISK,
    MtpBenchError,
    Table,
    clean_text,
    describe_write_error,
    reported,
    require_file,
    tables_text,
    to_text,
    write_text,
)

if TYPE_CHECKING:
    from ..cards import Card
    from ..running import RunOptions
    from ..scoring import Report
    from .shown import Shown

STANDARD_OUTPUT = Path("-")  # of `--json`
_FAILURES = 10  # that one line tells


@contextmanager
def working(label: str, options: "RunOptions") -> Iterator["RunOptions"]:
    """The options with progress that is told on the error stream."""
    with reported(label) as progress:
        yield replace(options, progress=progress)


def prepare(
    env: "str | Card", options: "RunOptions", agents: Iterable[str] = ()
) -> None:
    """Make simulated scenes, or the compact copy of tables, that are not in the cache yet.

    The ``agents`` are looked up first, so that a misspelt name is an error at once.
    """
    from ..agent import load_submission
    from ..sources import prepare as prepare_scenes

    for agent in agents:
        load_submission(agent)

    prepare_scenes(
        options.card(env), options.data, options.scenes, options.workers.count
    )


def said_of(error: MtpBenchError | OSError) -> str:
    """The text of an error; for an OSError, such as a full disk, with the file and what to do."""
    text, notes = str(error), getattr(error, "__notes__", ())
    if not isinstance(error, MtpBenchError):
        named = error.filename or error.filename2
        if not named and isinstance(error, FileNotFoundError):  # of Path.cwd
            return "the current folder does not exist any more: change to another one"
        if not named and error.errno in FULL_DISK:
            named = f"standard output, or temporary files in {tempfile.gettempdir()}"
        text = (
            f"{named}: {describe_write_error(error)}"
            if named
            else describe_write_error(error)
        )
    return "; ".join([text, *notes])


def fail(text: str) -> None:
    """Print one line on the error stream and leave with status 1."""
    typer.secho("error: ", fg="red", bold=True, err=True, nl=False)
    say(text)
    raise SystemExit(1)


def say(text: str) -> None:
    """Print one line on the error stream."""
    line = " ".join(part.strip() for part in text.splitlines())
    print(
        clean_text(line, len(line) + 1), file=sys.stderr
    )  # clean: it may contain names from a foreign submission


def show_report(
    report: "Report",
    of: str,
    skipped: Mapping[str, int],
    asked: "Shown",
    names: Sequence[str] | None = None,
) -> None:
    """Print the main table of a report ``of`` something, one sentence of verdict and warnings; with ``full`` all else.

    ``names``: submissions that the verdict is about; None for a report of one agent, which has none.
    """
    from ..running import skipped_line
    from ..viz import (
        full_tables,
        notes,
        short_verdict,
        show,
        show_lines,
        verdict,
        warnings,
    )

    condition = report.condition
    main, further = asked.main(report), list(full_tables(report)) if asked.full else []
    write_table(asked.table_file, [main, *further], asked.data(report))
    show(to_text(main).rstrip())
    trained = condition.get("trained")
    told = [
        short_verdict(report, names or ()),
        *warnings(report),
        trained,
        skipped_line(skipped),
    ]
    show_lines(filter(None, told))
    if not asked.full:
        show_lines([_way_on()])
        return
    show("")
    show_lines(verdict(report, names or ()), "- ")
    show_lines(notes(report))
    data = f"split {condition['split']}, {condition['detections']}; truth: {condition['truth']}"
    show_lines([f"{of}; {data}", condition["weights"]])
    for table in further:
        show("\n" + to_text(table).rstrip())


def _way_on() -> str:
    """One line that says where to go next; with the way to the command where a shell would not find it."""
    activate = Path(sys.executable).with_name("activate")
    if shutil.which("mtp-bench") or not (
        activate.is_file() and activate.is_relative_to(Path.cwd())
    ):
        return "Parts, other settings and conditions: --full"
    return f"Next: source {activate.relative_to(Path.cwd())}; mtp-bench --help. Parts and conditions: --full"


def write_table(path: Path | None, shown: Sequence[Table], data: Table) -> None:
    """Write tables to the file that is named, in the format of its suffix; see `tables_text`."""
    if path is not None:
        write_text(path, tables_text(path.suffix, shown, data))


class _Muted(io.StringIO):
    """A stream that discards what is printed, so that ``output`` gets the JSON alone."""

    def __init__(self, output: TextIO) -> None:
        super().__init__()
        self.output = output


def json_alone(context: typer.Context, path: Path | None) -> Path | None:
    """The path of ``--json``, which can be written; if it is standard output, nothing else is printed there."""
    if path == STANDARD_OUTPUT:
        output = context.with_resource(_standard_output_apart())
        context.with_resource(redirect_stdout(_Muted(output)))
    elif path is not None:
        require_file(path)
    return path


@contextmanager
def _standard_output_apart() -> Iterator[TextIO]:
    """Standard output of this process alone; the output of other processes goes to the error stream."""
    try:
        descriptor, errors = sys.stdout.fileno(), sys.stderr.fileno()
    except (AttributeError, OSError):  # one of them is closed or not a file
        yield sys.stdout
        return
    sys.stdout.flush()
    with os.fdopen(os.dup(descriptor), "w", encoding="utf-8") as own:
        os.dup2(errors, descriptor)
        try:
            yield own
        finally:
            own.flush()
            os.dup2(own.fileno(), descriptor)


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """Write the content of a table to a file or to standard output, if one is named."""
    if path is None:
        return
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    if path == STANDARD_OUTPUT:
        print(
            text,
            end="",
            file=sys.stdout.output if isinstance(sys.stdout, _Muted) else sys.stdout,
            flush=True,
        )
    else:
        write_text(path, text)


def print_or_write(path: Path | None, text: str) -> None:
    """Write a text to a file, or print it if no file is named."""
    if path is None:
        sys.stdout.write(text)
    else:
        write_text(path, text)


def some_of(texts: Sequence[str]) -> str:
    """Several failures in one line: the first ones, and the number of others."""
    more = len(texts) - _FAILURES
    return "; ".join([*texts[:_FAILURES], *([f"and {more} more"] if more > 0 else [])])
