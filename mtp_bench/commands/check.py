"""``mtp-bench check``."""

from dataclasses import asdict
from typing import Annotated

from typer import Option

from ..agent import load_submission
from ..core import Column, SubmissionError, Table, Workers, cores
from ..judge import SCENES, check_submission
from ..running import Finding, RunOptions
from ..viz import command_line, counted, show, show_table
from .options import DataOption, JsonOption, SubmissionArgument, TracksOption, absolute
from .output import prepare, working, write_json

_STYLE = {"error": "bold red", "warning": "yellow", "ok": ""}  # of a row


def check(
    path: SubmissionArgument,
    env: Annotated[
        str, Option(help="Environment to check on, of `mtp-bench envs`.")
    ] = "MTP-Intersection-v0",
    root: DataOption = None,
    tracks: TracksOption = None,
    scenes: Annotated[
        int, Option(min=1, max=SCENES, help="Scenes to check on.")
    ] = SCENES,
    json_file: JsonOption = None,
) -> None:
    """Check that a submission keeps the contract, on up to three scenes. Status 1 for errors."""
    options = RunOptions(
        root, scenes, track_file=absolute(tracks), workers=Workers(cores())
    )
    submission = load_submission(path)
    options.require_usable([submission])
    prepare(env, options)
    with working(f"checking {path}", options) as watched:
        findings = check_submission(submission, env, watched)
    write_json(
        json_file,
        {
            "submission": submission.name,
            "env": env,
            "findings": [asdict(each) for each in findings],
        },
    )
    columns = Column(key="level"), Column(key="check"), Column(key="found", read=_found)
    table = Table("findings", f"{submission.name} on {env}", "", findings, columns)
    show_table(table, style=lambda row: _STYLE[row.level])
    errors = sum(finding.level == "error" for finding in findings)
    if errors:
        raise SubmissionError(
            f"{submission.name} does not pass: {counted(errors, 'error')}, see the table"
        )
    compare = command_line("compare", path, env=env, data=root, tracks=tracks)
    show(f"{submission.name} passes; next: `{compare}`")


def _found(finding: Finding) -> str:
    """The finding, then its expected value, place and advice on lines of their own."""
    labels = (
        ("expected", finding.expected),
        ("where", finding.where),
        ("to do", finding.advice),
    )
    further = [f"{label}: {text}" for label, text in labels if text]
    return "\n".join(
        [finding.got, *(f"  {line}" for line in finding.traceback), *further]
    )
