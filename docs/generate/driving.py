"""Write the tables of the page on driving anew from `leaderboard/driving.json`.

    python -m docs.generate.driving [FIGURES.json ...]

Each file of figures, as `benchmarks/driving.py show --json` writes them, first takes the place of those of its
environment. Tables of an environment stand between ``<!-- driving: ID -->`` and ``<!-- /driving -->``, a table of all
after ``<!-- driving: in short -->``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from mtp_bench.core.files import write_text

from .blocks import filled_blocks

ROOT = Path(__file__).resolve().parents[2]
PAGE, FIGURES = (
    ROOT / "docs" / "environment" / "driving_results.md",
    ROOT / "leaderboard" / "driving.json",
)
NONE = "Not measured yet."


def filled(text: str, figures: Mapping[str, Any]) -> str:
    """``text`` with its tables made anew; ``figures``: by environment."""

    def tables(name: str) -> str:
        # the tables are those that the measurement prints
        printed = import_module("benchmarks.driving_tables")
        if name == "in short":
            return str(printed.in_short(figures).markdown().strip())
        if name not in figures:
            return NONE
        grids = printed.grids(figures[name])
        return "\n".join(grid.markdown() for grid in grids).strip()

    return filled_blocks(text, "driving", tables)


def rounded(value: Any) -> Any:
    """``value`` with its numbers rounded to six digits."""
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def main(paths: Sequence[str]) -> None:
    """Take in the figures of the files, and fill in the page."""
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    for path in paths:
        made = json.loads(Path(path).read_text(encoding="utf-8"))
        figures[made["env"]] = rounded(made)
    if paths:
        write_text(FIGURES, json.dumps(dict(sorted(figures.items())), indent=1) + "\n")
    write_text(PAGE, filled(PAGE.read_text(encoding="utf-8"), figures))


if __name__ == "__main__":
    main(sys.argv[1:])
