"""Numbers of the paper, shown beside ours."""

from functools import cache
from typing import Any

from ...agent import controls
from ...core import toml_beside
from ...scoring import Row, Subset

PaperErrors = dict[str, list[float]]  # subset of the paper -> minADE, minFDE in metres
PAPER_SUBSETS: dict[Subset, str] = {  # ours -> the paper's
    "all": "all",
    "paper_ids": "ids",
    "paper_frag": "frag",
}


def paper_errors(env_id: str, row: Row) -> PaperErrors:
    """Return the paper's errors for the setting of ``row``, if any."""
    roles = {agent: role for role, agent in controls().items()}
    role = roles.get(row.agent, "")
    errors = _dataset_errors(env_id).get(role, {})
    if role == "several":  # the paper has errors for each budget and number H
        return dict(errors.get(row.budget, {}).get(str(row.hypotheses), {}))
    return dict(errors)


@cache
def _dataset_errors(env_id: str) -> dict[str, Any]:
    """Return the paper's table of an env, empty for others."""
    paper = toml_beside(__file__, "paper.toml")
    return dict(paper.get(paper["dataset"].get(env_id, ""), {}))
