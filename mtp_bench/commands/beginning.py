"""What `mtp-bench new` does: a submission to start from, and what to do with it."""

from __future__ import annotations

import shlex
from pathlib import Path


def begin(name: str, parent: Path) -> str:
    """Write the template as ``parent / name``; returns what to tell the user.

    Raises MtpBenchError for a name that cannot be used and a folder that is there or cannot be written.
    """
    from ..submission.starting import new_submission

    folder = new_submission(name, parent)
    shown = shlex.quote(str(folder))
    return "\n".join(
        [
            f"{folder}: submission.toml, agent.py (an agent that works), README.md",
            "1. put your name into submission.toml, and your idea into agent.py",
            f"2. mtp-bench check {shown}",
            f"3. mtp-bench compare {shown} --env MTP-Intersection-v0 --scenes 5",
            f"4. mtp-bench submit {shown} --env MTP-Intersection-v0",
        ]
    )
