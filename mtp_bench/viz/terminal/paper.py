"""Numbers of the paper, shown beside ours."""

from functools import cache
from typing import Any

from ...agent import controls
from ...core import toml_beside
from ...scoring import Row, Subset

Figures = dict[str, list[float]]  # subset -> minADE, minFDE in metres
PAPER_SUBSETS: dict[Subset, str] = {
    "all": "all",
    "paper_ids": "ids",
    "paper_frag": "frag",
}  # ours -> the paper's
PAPER_HYPOTHESES = 20  # of MTP in the paper's tables
_ROLES = {name: role for role, name in controls().items()}


def paper_figures(env_id: str, row: Row) -> Figures:
    """The paper's numbers for the env and setting of ``row``; empty where it has none."""
    return figures_of(env_id, _ROLES.get(row.agent, ""), row.budget, row.hypotheses)


def paper_gap(env_id: str, row: Row) -> float | None:
    """Share of the gap on IDS that the agent of ``row`` closes in the paper, by minADE; None if unknown."""
    truth, stp = (
        figures_of(env_id, role, row.budget, 1).get("ids")
        for role in ("ground_truth", "single")
    )
    own = paper_figures(env_id, row).get("ids")
    if own is None or truth is None or stp is None:
        return None
    return (stp[0] - own[0]) / (stp[0] - truth[0])


def shared_events(env_id: str) -> dict[str, dict[str, int]]:
    """The paper's events of "one" hypothesis, and of "all" 20 of them, by kind; empty where it has none."""
    return dict(_paper_of(env_id).get("shared", {}))


def figures_of(env_id: str, role: str, budget: str, hypotheses: int) -> Figures:
    """The paper's numbers for an env and the baseline with a role in comparisons; empty where it has none."""
    figures = _paper_of(env_id).get(role, {})
    if role == "several":
        figures = figures.get(budget, {}).get(str(hypotheses), {})
    return dict(figures)


@cache
def _paper_of(env_id: str) -> dict[str, Any]:
    paper = toml_beside(__file__, "paper.toml")
    return paper.get(paper["dataset"].get(env_id, ""), {})  # type: ignore[no-any-return]  # a table of TOML
