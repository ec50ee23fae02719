"""``mtp-bench new`` and ``mtp-bench check``."""

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..agent import load_submission, new_submission
from ..core import Column, SubmissionError, Table, Workers, cores, long_work
from ..judge import MAX_CHECKED_SCENES, check_submission
from ..running import Finding, RunOptions
from ..viz import command_line, counted, show, show_table
from .options import (
    DataOption,
    JsonOption,
    NoDoctorOption,
    SubmissionArgument,
    TracksOption,
    only_path,
)
from .output import prepare, write_json


def new(
    name: Annotated[str, Argument(help="Name of the submission: lower case.")],
    folder: Annotated[Path, Option(help="Where its folder is made.")] = Path(),
) -> None:
    """Begin a submission: a folder with an agent that works."""
    path = new_submission(name, folder)
    word = shlex.quote(str(path))
    lines = (
        f"{path}: submission.toml, agent.py (an agent that works), README.md",
        "1. put your name into submission.toml, and your idea into agent.py",
        f"2. mtp-bench check {word}",
        f"3. mtp-bench compare {word} --env MTP-Intersection-v0 --scenes 5",
        f"4. mtp-bench submit {word} --env MTP-Intersection-v0",
    )
    show("\n".join(lines))


_ROW_STYLES = {"error": "bold red", "warning": "yellow", "ok": ""}


def check(
    path: SubmissionArgument,
    env: Annotated[
        str, Option(help="Environment to check on, of `mtp-bench envs`.")
    ] = "MTP-Intersection-v0",
    root: DataOption = None,
    tracks: TracksOption = None,
    scenes: Annotated[
        int, Option(min=1, max=MAX_CHECKED_SCENES, help="Scenes to check on.")
    ] = MAX_CHECKED_SCENES,
    no_doctor: NoDoctorOption = False,
    json_file: JsonOption = None,
) -> None:
    """Check a submission on up to three scenes.

    The exit status is 1 if there are errors.
    """
    workers = Workers(cores())
    options = RunOptions(
        root, scenes, tracks=only_path(tracks, "--tracks"), workers=workers
    )
    submission = load_submission(path)
    options.require_usable([submission])
    prepare(env, options, no_doctor=no_doctor)
    with long_work(f"checking {path}") as progress:
        options = replace(options, progress=progress)
        findings = check_submission(submission, env, options)
    rows = [asdict(finding) for finding in findings]
    write_json(json_file, {"submission": submission.name, "env": env, "findings": rows})
    columns = Column(key="level"), Column(key="check"), Column(key="found", read=_text)
    table = Table("findings", f"{submission.name} on {env}", "", findings, columns)
    show_table(table, style=lambda row: _ROW_STYLES[row.level])
    errors = sum(finding.level == "error" for finding in findings)
    if errors:
        raise SubmissionError(
            f"{submission.name} does not pass: {counted(errors, 'error')}, "
            "see the table"
        )
    compare = command_line("compare", path, env=env, data=root, tracks=tracks)
    show(f"{submission.name} passes; next: `{compare}`")


def _text(finding: Finding) -> str:
    """Return a finding, then its expected value, place and advice on further lines."""
    lines = [finding.got, *(f"  {line}" for line in finding.traceback)]
    if finding.expected:
        lines.append(f"expected: {finding.expected}")
    if finding.where:
        lines.append(f"where: {finding.where}")
    if finding.advice:
        lines.append(f"to do: {finding.advice}")
    return "\n".join(lines)
