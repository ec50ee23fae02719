"""``mtp-bench new``."""

import shlex
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..agent import new_submission
from ..viz import show


def new(
    name: Annotated[str, Argument(help="Name of the submission: lower case.")],
    folder: Annotated[Path, Option(help="Where its folder is made.")] = Path(),
) -> None:
    """Begin a submission: a folder with an agent that works."""
    made = new_submission(name, folder)
    shown = shlex.quote(str(made))
    lines = (
        f"{made}: submission.toml, agent.py (an agent that works), README.md",
        "1. put your name into submission.toml, and your idea into agent.py",
        f"2. mtp-bench check {shown}",
        f"3. mtp-bench compare {shown} --env MTP-Intersection-v0 --scenes 5",
        f"4. mtp-bench submit {shown} --env MTP-Intersection-v0",
    )
    show("\n".join(lines))
