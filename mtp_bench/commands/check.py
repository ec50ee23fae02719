"""``mtp-bench check``."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from ..errors import SubmissionError
from ..parallel import Workers, cores
from ..records.checking import SCENES, SubmissionCheck, check_submission
from ..running.options import RunOptions
from ..submission.loader import load_submission
from ..tables import BLANK
from ..viz.terminal.output import command_line, counted, new_table, number, show, show_numbers
from .options import DataOption, JsonOption, ScenesOption, SubmissionArgument, TracksOption, absolute
from .output import prepare, require_writable, working, write_json

_STYLE = {"error": "bold red", "warning": "yellow", "ok": "green"}


def check(
    path: SubmissionArgument,
    env: Annotated[
        str, typer.Option(help="Environment to check on; `mtp-bench envs` lists them.")
    ] = "MTP-Intersection-v0",
    root: DataOption = None,
    tracks: TracksOption = None,
    scenes: ScenesOption = None,
    json_file: JsonOption = None,
) -> None:
    """Check that a submission keeps the contract, and compare up to three scenes with STP. Status 1 for errors."""
    require_writable(json_file)
    if scenes is not None and scenes > SCENES:
        raise typer.BadParameter(f"{scenes}, expected at most {SCENES}: the limit of a check", param_hint="--scenes")
    options = RunOptions(root, scenes or SCENES, track_file=absolute(tracks), workers=Workers(cores()))
    options.require_tracks_used([load_submission(path)])
    prepare(env, options)
    with working("check", options) as watched:
        checked = check_submission(path, env, watched)
    write_json(json_file, checked.to_json())
    show(finding_table(checked))
    if checked.scores:
        show_numbers(_score_table(checked))
    if checked.errors:
        errors = counted(checked.errors, "error")
        raise SubmissionError(f"{checked.submission} does not pass: {errors}, see the table")
    show("with every forecast kept; agents are ranked by bADE, which `compare` gives")
    compare = command_line("compare", path, env=checked.env, data=root, tracks=tracks)
    show(f"{checked.submission} passes; next: `{compare}`")


def finding_table(checked: SubmissionCheck) -> Table:
    """Table of the findings, with expected value, place and advice below each that is not ok."""
    from rich.markup import escape

    table = Table(title=escape(f"{checked.submission} on {checked.env}"), title_justify="left")
    table.add_column("", no_wrap=True)
    table.add_column("check", no_wrap=True)
    table.add_column("found", overflow="fold")
    for finding in checked.findings:
        lines = [finding.got, *(f"  {line}" for line in finding.traceback)]
        for label, text in (("expected", finding.expected), ("where", finding.where), ("to do", finding.advice)):
            lines += [f"{label}: {text}"] if text else []
        style = _STYLE[finding.level]
        table.add_row(f"[{style}]{finding.level}[/{style}]", finding.check, escape("\n".join(lines)))
    return table


def _score_table(checked: SubmissionCheck) -> Table:
    """Plain error and false forecasts per scene, beside those of the reference."""
    from rich.markup import escape

    own, other = escape(checked.submission), checked.reference
    headings = ("scene", "targets", own, other, "covered", f"false, {own}", f"false, {other}")
    table = new_table("plain error (m), lower is better, and false forecasts", headings, left=("scene",))
    for row in checked.scores:
        covered = BLANK if row["coverage"] is None else f"{row['coverage']:.0%}"
        errors = (number(row[key]) for key in ("plain_error", other))
        false = (
            BLANK if row[key] is None else str(row[key]) for key in ("false_forecasts", f"{other}_false_forecasts")
        )
        table.add_row(escape(row["scene"]), str(row["targets"]), *errors, covered, *false)
    return table
