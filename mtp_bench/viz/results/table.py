"""Tables of one environment in Markdown: a row per agent, a column per measure and subset, and below what it is of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...errors import UnknownNameError
from ...records.ranking import STP
from ...scoring.rows import Row
from ...scoring.subsets import Subset
from ..terminal.output import NOTHING
from .figure import Figure, Kind, signed
from .figures import Figures
from .known import Known, Scored, subset_of

LABELS = {  # of agents; others are shown by name
    "truth_past": "true pasts", "truth_modes": "true pasts, modes", "truth_ptp": "true pasts, PTP",
    "stp": "STP", "stp_same_budget": "STP, same budget", "stp_hedged": "STP, hedged",
    "mtp": "MTP, H = 20", "stp_cut": "STP, input cut", "mtp_cut": "MTP, input cut",
}  # fmt: skip
SUBSET_LABELS: dict[Subset, str] = {"paper_ids": "paper IDS", "paper_frag": "paper FRAG"}
COLUMNS = (
    "error all", "rank all", "error ids", "rank ids", "error reacquired", "rank reacquired", "plain all", "minADE all",
    "minADE paper_ids", "minADE paper_frag", "coverage all", "ms all",
)  # fmt: skip
_FIELDS: dict[str, tuple[str, Kind]] = {  # measure -> field of a row, kind
    "error": ("error", "length"), "plain": ("plain_error", "length"), "missed": ("missed", "length"),
    "minADE": ("minADE", "length"), "minFDE": ("minFDE", "length"), "coverage": ("coverage", "share"),
}  # fmt: skip
MEASURES = (*_FIELDS, "rank", "gap", "own_gap", "less_stp", "ms")
_ALONE = {"error": "", "rank": "rank", "coverage": "coverage", "ms": "ms per frame"}  # headings without their subset
_HEADINGS = {"gap": "gap closed (%)", "own_gap": "gap of its own predictor (%)", "less_stp": "less STP"}


@dataclass(frozen=True)
class Column:
    """A column of a table: "MEASURE SUBSET" in a template."""

    measure: str
    subset: Subset

    @property
    def heading(self) -> str:
        """What stands above it."""
        label = SUBSET_LABELS.get(self.subset, self.subset)
        if self.measure == "error":
            return label
        if self.measure == "rank" or (self.measure in _ALONE and self.subset == "all"):
            return _ALONE[self.measure]
        return f"{_HEADINGS.get(self.measure, self.measure)}, {label}"


class Tables:
    """Tables of known records."""

    def __init__(self, known: Known) -> None:
        self._known = known
        self._figures = Figures(known)

    def table(
        self, env: str, agents: Sequence[str], columns: Sequence[str] = COLUMNS, digits: int = 2, of: bool = True
    ) -> str:
        """A table of ``agents`` in this order; each of the ``columns`` is "MEASURE SUBSET".

        ``digits`` of metres after the point. ``of``: the last lines say how many targets, objects, scenes and units.
        Raises UnknownNameError for a misspelt name, RecordError where a record is missing.
        """
        shown = [_column(text) for text in columns]
        found = self._known.beside(env, *agents)
        rows = [[label(agent), *(self._cell(column, agent, env, digits) for column in shown)] for agent in agents]
        counts = [_counts(found[0], shown, *kind) for kind in _COUNTS] if of and found else []
        return markdown(["agent", *(column.heading for column in shown)], [*rows, *counts])

    def across(
        self, envs: Sequence[tuple[str, str]], agents: Sequence[str], subset: str = "ids", digits: int = 2
    ) -> str:
        """One subset on several environments, what ranks with its interval: ``envs`` are pairs of heading and id."""
        rows = [
            [label(agent), *(self._cell(Column("error", subset_of(subset)), agent, env, digits) for _, env in envs)]
            for agent in agents
        ]
        what, effective = _COUNTS[1]
        counts = [effective(self._known.beside(env, *agents)[0].row(subset)) for _, env in envs]
        return markdown(["agent", *(heading for heading, _ in envs)], [*rows, [what, *counts]])

    def _cell(self, column: Column, agent: str, env: str, digits: int) -> str:
        scored = self._known.of(agent, env)
        row = scored.row(column.subset)
        if column.measure == "rank":
            rank = scored.place(column.subset).rank
            return NOTHING if rank is None else str(rank)
        if column.measure in _HEADINGS:
            return self._compared(column, agent, env, digits)
        if column.measure == "ms":
            value: float | None = scored.record.measured.ms_per_frame
            return NOTHING if value is None else signed(value, 1)
        name, kind = _FIELDS[column.measure]
        value = getattr(row, name)
        if value is None:
            return NOTHING
        figure = Figure("", value, kind, row.interval if column.measure == "error" else None)
        return str(figure) if kind == "share" else figure.to(digits).ranged

    def _compared(self, column: Column, agent: str, env: str, digits: int) -> str:
        """What its record is beside those of others."""
        figures, subset = self._figures, column.subset
        if self._known.of(agent, env).row(subset).error is None:
            return NOTHING
        if column.measure == "less_stp":
            return figures.difference(agent, STP, env, subset).to(digits).ranged
        if column.measure == "own_gap":
            known = figures.has_same_predictor_gap(agent, env, subset)
            return figures.same_predictor_gap(agent, env, subset).ranged if known else NOTHING
        return figures.gap(agent, env, subset).ranged if figures.has_gap(env, subset) else NOTHING


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; the first column is aligned left, the others right."""
    lines = [headings, ["---", *["--:"] * (len(headings) - 1)], *rows]
    head, rule, *body = (" | ".join(map(cell, line)) for line in lines)
    return "\n".join([f"| {head} |", f"|{rule.replace(' ', '')}|", *(f"| {line} |" for line in body)])


def cell(text: str) -> str:
    """Text that ends no cell of a table, and no line."""
    return " ".join(text.split()).replace("\\", "\\\\").replace("|", "\\|")


def label(agent: str) -> str:
    """The name of an agent as pages write it."""
    return LABELS.get(agent, f"`{agent}`")


def _column(text: str) -> Column:
    measure, _, subset = text.partition(" ")
    if measure not in MEASURES:
        raise UnknownNameError("measure", measure, MEASURES, f'of the column {text!r}, expected "MEASURE SUBSET"')
    return Column(measure, subset_of(subset or "all"))


_COUNTS: tuple[tuple[str, Callable[[Row], str]], ...] = (
    ("targets, objects, scenes", lambda row: f"{row.targets}, {row.objects}, {row.scenes}"),
    ("effective objects, units", lambda row: f"{row.effective_objects:.0f}, {row.effective_units:.1f}"),
)


def _counts(scored: Scored, columns: Sequence[Column], heading: str, text: Callable[[Row], str]) -> list[str]:
    """A line below a table: each subset in its first column."""
    first = {column.subset: place for place, column in reversed(list(enumerate(columns)))}
    return [
        heading,
        *(text(scored.row(column.subset)) if first[column.subset] == i else "" for i, column in enumerate(columns)),
    ]
