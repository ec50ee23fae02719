"""The command line: ``mtp-bench``.

Exit status 0, 1 for a failure that the message explains, 2 for wrong usage.
"""

import importlib
import io
import keyword
import os
import re
import signal
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from typer import BadParameter, Exit, Option, Typer
from typer.core import TyperGroup
from typer.main import get_command

from ..core import ENDING_SIGNALS, MtpBenchError, __version__, clean_text, long_work
from .output import error_text, fail, say

NUMBA_SETTINGS = Path(".numba_config.yaml")  # read by Numba from the current folder
SIGNALLED = 128  # exit status after a signal, less its number, as shells have it
_MAX_SHOWN = 100  # characters of a wrong value
_TEXT_FILE = Path(__file__).with_name("commands.toml")
_TEXTS = tomllib.loads(_TEXT_FILE.read_text(encoding="utf-8"))
SUMMARIES = _TEXTS["summaries"]  # by command
MODULES = _TEXTS["modules"]  # by command, where the file has another name
INTERRUPTED_NOTES = _TEXTS["interrupted"]  # by command
GROUPS = _TEXTS["groups"]  # options by heading of the help
WHOLE_FILES = "files are complete or not there"  # after an interruption
_received: list[int] = []  # numbers of signals to end
_MANY_OPTIONS = 12  # from so many on they are grouped


class Commands(TyperGroup):
    """All commands, imported when they are used, so that ``--help`` starts at once.

    The command ``x-y`` is the function, or the group, ``x_y`` of the module ``x_y``,
    or of the one that ``commands.toml`` names. Wrong usage is reported with the value
    that was got.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        # typer takes its list and its suggestions for a misspelt name from here
        names: Any = dict.fromkeys(SUMMARIES)
        self.commands = names

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command.

        None for an unknown name.
        """
        if cmd_name not in SUMMARIES:
            return None
        module_name = MODULES.get(cmd_name, cmd_name)
        module = importlib.import_module(f"mtp_bench.commands.{module_name}")
        function_name = cmd_name.replace("-", "_")
        if keyword.iskeyword(function_name):
            function_name += "_"
        content = getattr(module, function_name)
        if isinstance(content, Typer):
            return _prepared(get_command(content))
        from .options import with_expanded_options

        command_app = Typer(
            add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
        )
        command_app.command(cmd_name)(with_expanded_options(content))
        return _prepared(get_command(command_app))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names and summaries without importing a command."""
        with formatter.section("Commands"):
            formatter.write_dl(list(SUMMARIES.items()))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse an empty word, which would mean the current folder as a path.

        It may stand alone, or be the value of an option.
        """
        if not ctx.resilient_parsing:
            for before, word in pairwise(["mtp-bench", *args]):
                if re.fullmatch("(--[a-z-]+=)?", word):
                    raise BadParameter(
                        f"got an empty word at {word or before!r}, expected a value: "
                        "is a variable of the shell unset?",
                        ctx,
                    )
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command."""
        try:
            command_words = ["mtp-bench", *sys.argv[1:2]]
            with long_work(" ".join([*command_words, "is working"])):
                return super().invoke(ctx)
        except BadParameter as error:
            from pydantic import ValidationError

            # its message has what was expected, but not the value
            if isinstance(error.__cause__, ValidationError):
                value = clean_text(
                    repr(error.__cause__.errors()[0]["input"]), _MAX_SHOWN
                )
                error.message = f"got {value}: {error.message}"
            raise


def _prepared(command: Any) -> Any:
    return _grouping_options(_refusing_repeated_options(command))


def _refusing_repeated_options(command: Any) -> Any:
    """Return a command, or group, that refuses an option that is given twice.

    Else the last one would count, without a word. Some options take several.
    """
    for subcommand in getattr(command, "commands", {}).values():
        _refusing_repeated_options(subcommand)
    parse_args = command.parse_args

    def parse_args_once(ctx: Any, args: list[str]) -> list[str]:
        if not ctx.resilient_parsing:
            _, _, given = command.make_parser(ctx).parse_args(list(args))
            for option in given:
                is_single = option.param_type_name == "option" and not option.multiple
                if is_single and given.count(option) > 1:
                    raise BadParameter("given twice, expected once", ctx, option)
        return parse_args(ctx, args)  # type: ignore[no-any-return]

    command.parse_args = parse_args_once
    return command


def _grouping_options(command: Any) -> Any:
    """Return a command, or group, whose help shows many options by group."""
    for subcommand in getattr(command, "commands", {}).values():
        _grouping_options(subcommand)
    if len(command.params) < _MANY_OPTIONS:
        return command
    headings = {name: heading for heading, names in GROUPS.items() for name in names}

    def format_groups(ctx: Any, formatter: Any) -> None:
        lines: dict[str, list[Any]] = {"Arguments": []}
        lines |= {heading: [] for heading in (*GROUPS, "Options")}
        for parameter in command.get_params(ctx):
            heading = headings.get(parameter.name, "Options")
            if parameter.param_type_name == "argument":
                heading = "Arguments"
            lines[heading].append(parameter.get_help_record(ctx))
        for heading, records in lines.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)

    command.format_options = format_groups
    return command


app = Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(is_asked_for: bool) -> None:
    if is_asked_for:
        print(f"mtp-bench {__version__}")
        raise Exit


@app.callback()
def about(
    version: Annotated[
        bool,
        Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Show the version.",
        ),
    ] = False,
) -> None:
    """Tracking and prediction together: your agent sees detections, not the truth."""


def main() -> None:
    """Run the command of ``sys.argv``.

    Errors of the library become one line and exit status 1, and a signal to end one
    line and 128 plus its number.
    """
    # before NumPy loads, and for workers: matrices are small
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_streams()
    _interrupt_at_signals()
    if NUMBA_SETTINGS.exists():  # those of a submission would change how the judge runs
        fail(
            f"{NUMBA_SETTINGS.absolute()} would change how Numba compiles: "
            "run from another folder, or remove it"
        )
    try:
        try:
            app(prog_name="mtp-bench")
        finally:
            _ignore_signals()
            _flush()
    except BrokenPipeError:  # the reader has enough
        raise SystemExit(1) from None
    except (MtpBenchError, OSError) as error:
        fail(error_text(error))
    finally:
        if _received:  # typer ends with another status, in silence
            command = next(iter(sys.argv[1:2]), "")
            say(f"interrupted; {INTERRUPTED_NOTES.get(command, WHOLE_FILES)}")
            raise SystemExit(SIGNALLED + _received[0]) from None


def _interrupt_at_signals() -> None:
    """Let SIGTERM and SIGHUP interrupt as Ctrl-C does, unless they are ignored."""

    def interrupt(number: int, _: object) -> None:
        _ignore_signals()
        _received.append(number)
        raise KeyboardInterrupt

    for each in ENDING_SIGNALS:
        if signal.getsignal(each) != signal.SIG_IGN:  # as under nohup
            signal.signal(each, interrupt)


def _ignore_signals() -> None:
    """Let nothing but SIGKILL disturb the end, which removes temporary files."""
    for each in ENDING_SIGNALS:
        signal.signal(each, signal.SIG_IGN)


def _open_streams() -> None:
    """Open standard streams that are closed, and let them take names of any bytes."""
    modes = {"stdin": "r", "stdout": "w", "stderr": "w"}  # in order of descriptors
    for name, mode in modes.items():
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _flush() -> None:
    """Write buffered output now.

    An error at the end of the interpreter would have no clear message.
    """
    try:
        sys.stdout.flush()
    except OSError:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
        raise
