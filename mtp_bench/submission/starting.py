"""Start a submission: a folder with a working agent, made from the template."""

import re
from pathlib import Path

from .._bundle import baseline_names
from ..errors import SubmissionError
from ..files import require_folder, whole_folder
from .manifest import MANIFEST, MOST_NAME, NAME_RULE, is_name

TEMPLATE = Path(__file__).parent / "template"
FILES = (MANIFEST, "agent.py", "README.md")


def new_submission(name: str, parent: Path) -> Path:
    """Folder ``parent / name`` with the template under this name.

    Raises SubmissionError for a wrong or a baseline's name and an existing folder, MtpBenchError where writing fails.
    """
    if not is_name(name):
        plain = re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-_")[:MOST_NAME]
        near = plain if is_name(plain) else f"my-{plain or 'agent'}"
        raise SubmissionError(f"{name!r} is not a name for a submission: {NAME_RULE}; choose another, such as {near!r}")
    if name in baseline_names():
        raise SubmissionError(f"{name!r} is the name of a baseline, which commands would take instead: choose another")
    folder = parent / name
    if folder.exists() or folder.is_symlink():
        raise SubmissionError(f"{folder} exists already, expected a new folder: choose another name, or remove it")
    require_folder(folder)
    with whole_folder(folder) as part:
        for file in FILES:
            text = (TEMPLATE / file).read_text(encoding="utf-8")
            (part / file).write_text(re.sub(r"\bNAME\b", name, text), encoding="utf-8")
    return folder
