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
