"""Printing and writing, shared by the commands."""

import io
import json
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

from ..core import (
    FULL_DISK,
    MtpBenchError,
    Table,
    clean_text,
    describe_write_error,
    require_file,
    tables_text,
    write_text,
)

if TYPE_CHECKING:
    from ..cards import Card
    from ..doubts import Doubt
    from ..running import RunOptions

STANDARD_OUTPUT = Path("-")  # of `--json`
_MAX_FAILURES = 10  # named in one line


def prepare(
    env: "str | Card",
    options: "RunOptions",
    agents: Iterable[str] = (),
    no_doctor: bool = True,
) -> "list[Doubt]":
    """Make simulated scenes, or the compact copy of tables, unless they are cached.

    The ``agents`` are looked up first, so that a misspelt name is an error at once.
    Unless ``no_doctor``, doubts about the data are returned, and printed on the error
    stream.
    """
    from ..agent import load_submission
    from ..sources import prepare as prepare_scenes

    for agent in agents:
        load_submission(agent)
    card = options.card(env)
    prepare_scenes(card, options.data, options.scenes, options.workers.count)
    if no_doctor or card.is_trusted:
        return []
    from ..cards import as_recorded
    from ..running import doctor, doubt_lines

    # errors that are asked for are no doubts
    doubts = doctor(as_recorded(card), options.unchanged).doubts
    for line in doubt_lines(doubts):
        say(line)
    return doubts


def error_text(error: MtpBenchError | OSError) -> str:
    """Return the text of an error.

    That of an OSError, such as a full disk, names the file and says what to do.
    """
    text = str(error)
    if not isinstance(error, MtpBenchError):
        file = error.filename or error.filename2
        if not file and isinstance(error, FileNotFoundError):  # of Path.cwd
            return "the current folder does not exist any more: change to another one"
        if not file and error.errno in FULL_DISK:
            file = f"standard output, or temporary files in {tempfile.gettempdir()}"
        text = describe_write_error(error)
        if file:
            text = f"{file}: {text}"
    return "; ".join([text, *getattr(error, "__notes__", ())])


def fail(text: str) -> None:
    """Print one line on the error stream and leave with status 1."""
    typer.secho("error: ", fg="red", bold=True, err=True, nl=False)
    say(text)
    raise SystemExit(1)


def say(text: str) -> None:
    """Print one line on the error stream, without control characters.

    It may contain names from a foreign submission.
    """
    line = " ".join(part.strip() for part in text.splitlines())
    whole_length = len(line) + 1
    print(clean_text(line, whole_length), file=sys.stderr)


def some_of(texts: Sequence[str]) -> str:
    """Return several failures in one line: the first, and the number of others."""
    lines = list(texts[:_MAX_FAILURES])
    if len(texts) > _MAX_FAILURES:
        lines.append(f"and {len(texts) - _MAX_FAILURES} more")
    return "; ".join(lines)


def write_table(path: Path | None, shown: Sequence[Table], data: Table) -> None:
    """Write tables to the file that is named, if any, by its suffix.

    See `tables_text`.
    """
    if path is not None:
        write_text(path, tables_text(path.suffix, shown, data))


def print_or_write(path: Path | None, text: str) -> None:
    """Write a text to a file, or print it if no file is named."""
    if path is None:
        sys.stdout.write(text)
    else:
        write_text(path, text)


class _Muted(io.StringIO):
    """A stream that discards its text, so that ``output`` gets the JSON alone."""

    def __init__(self, output: TextIO) -> None:
        super().__init__()
        self.output = output


def json_alone(context: typer.Context, path: Path | None) -> Path | None:
    """Return the path of ``--json``, which can be written.

    If it is standard output, nothing else is printed there.
    """
    if path == STANDARD_OUTPUT:
        output = context.with_resource(_standard_output_apart())
        context.with_resource(redirect_stdout(_Muted(output)))
    elif path is not None:
        require_file(path)
    return path


@contextmanager
def _standard_output_apart() -> Iterator[TextIO]:
    """Yield a standard output to which only this process writes.

    What other processes write to standard output goes to the error stream.
    """
    try:
        descriptor = sys.stdout.fileno()
        errors = sys.stderr.fileno()
    except (AttributeError, OSError):  # one of them is closed or not a file
        yield sys.stdout
        return
    sys.stdout.flush()
    with os.fdopen(os.dup(descriptor), "w", encoding="utf-8") as output:
        os.dup2(errors, descriptor)
        try:
            yield output
        finally:
            output.flush()
            os.dup2(output.fileno(), descriptor)


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """Write the content of a table to the file or stream that is named."""
    if path is None:
        return
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    if path != STANDARD_OUTPUT:
        write_text(path, text)
        return
    stream = sys.stdout
    if isinstance(stream, _Muted):
        stream = stream.output
    print(text, end="", file=stream, flush=True)
