"""The parts of bADE of each agent, in one line."""

from __future__ import annotations

from ...scoring import Report
from ...scoring.parts import PARTS
from ...scoring.rank import ASSOCIATED
from ...scoring.rows import Row
from ...tables import Column

REFERENCES = ("saw the truth", ASSOCIATED)  # reasons of `why_unranked`
_LEAST = 0.005  # m: smaller parts are left out of a line
_METRES = Column(format=".2f")


def label_of(row: Row) -> str:
    """The agent of a row, with its number of hypotheses."""
    return f"{row.agent} (H = {row.hypotheses})" if row.hypotheses > 1 else row.agent


def parts_text(row: Row) -> str:
    """The parts of bADE of a row in one line, without those below half a centimetre."""
    parts = ((name, getattr(row, f"cost_{key}")) for key, name in PARTS.items())
    return ", ".join(f"{name} {_METRES.text(part)}" for name, part in parts if abs(part or 0.0) >= _LEAST)


def part_lines(report: Report) -> list[str]:
    """The parts of bADE of each agent with k samples and the most hypotheses, over all targets, but of references."""
    rows = [row for row in report.rows if row.subset == "all" and row.budget == "equal"]
    most = {row.agent: row for row in sorted(rows, key=lambda row: row.hypotheses)}
    rows = [row for row in rows if row is most[row.agent] and row.unranked_because not in REFERENCES]
    lines = [f"{label_of(row)}: {text}" for row in rows if (text := parts_text(row))]
    rest = "; rest: of forecasts, where no reference runs split it" if any(row.cost_rest for row in rows) else ""
    return [f"Parts of bADE over all targets, m{rest}", *lines] if lines else []
