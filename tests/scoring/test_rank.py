"""Who is ranked, on what, and in which order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.errors import ShapeError
from mtp_bench.scoring import ranks_by_test
from mtp_bench.scoring.rank import Entrant, guard, why_not_on, why_unranked
from mtp_bench.scoring.statistics import paired_difference


def test_ranks_count_those_that_are_significantly_better() -> None:
    rng = np.random.default_rng(5)
    unit = rng.normal(10, 3, 15)
    noise = rng.normal(0, 0.5, 15)
    noise -= noise.mean()
    agents = [unit + 5.0 + noise, unit + noise, unit, unit + 5.0, unit + 9.0]
    assert ranks_by_test(agents) == [3, 1, 1, 3, 5]
    assert ranks_by_test(np.zeros((0, 4))) == []


@pytest.mark.parametrize(("units", "ranks"), [(5, [1, 1]), (6, [1, 2])])
def test_five_units_can_never_tell_agents_apart(units: int, ranks: list[int]) -> None:
    assert ranks_by_test([np.zeros(units), np.ones(units)]) == ranks  # p is 2 / 2^units


def test_rounding_is_no_difference() -> None:
    unit = np.linspace(1.0, 9.0, 8)
    above = np.nextafter(unit, np.inf)  # in every unit: without a tolerance p is 2 / 2^8
    assert ranks_by_test([unit, above]) == [1, 1]
    difference = paired_difference(above, unit, np.ones(8))
    assert difference is not None
    assert difference.p == 1.0
    assert guard(float(above.sum()), float(unit.sum())) is None


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 10_000))
def test_the_order_of_agents_does_not_matter_and_nobody_beats_the_better_of_two(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sums = rng.normal(10, 1, (5, 8)) + rng.uniform(0, 3, (5, 1))
    ranks = np.array(ranks_by_test(sums))
    order = rng.permutation(5)
    assert ranks_by_test(sums[order]) == ranks[order].tolist()
    assert ranks[np.argmin(sums.sum(axis=1))] == 1
    better = sums - 0.5  # everyone, in every unit: nothing changes
    assert ranks_by_test(better) == ranks.tolist()


def test_agents_need_the_same_units() -> None:
    with pytest.raises(ShapeError, match="sums has shape"):
        ranks_by_test([1.0, 2.0])


ENTRANTS = {
    "honest": (Entrant("equal", 10, saw_truth=False), None),
    "true pasts": (Entrant("equal", 10, saw_truth=True), "saw the truth"),
    "more samples": (Entrant("free", 40, saw_truth=False), "40 samples per object, not the env's own k"),
    "half a run": (Entrant("equal", 10, saw_truth=False, unfinished="3 of 9 scenes"), "3 of 9 scenes"),
}


@pytest.mark.parametrize(("entrant", "why"), ENTRANTS.values(), ids=ENTRANTS.keys())
def test_who_is_ranked(entrant: Entrant, why: str | None) -> None:
    assert why_unranked(entrant) == why


SUBSETS = {
    # subset, effective objects, weight of the units: why nobody is ranked
    "all": ("all", 20.0, np.ones(6), None),
    "ids": ("ids", 20.0, np.ones(6), None),
    "reacquired": ("reacquired", 99.0, np.ones(9), None),
    "lost is shown": ("lost", 99.0, np.ones(9), "shown only"),
    "the paper's subsets are shown": ("paper_ids", 99.0, np.ones(9), "shown only"),
    "few objects": ("ids", 19.9, np.ones(9), "19.9 objects, fewer than 20"),
    "few units": ("all", 99.0, np.ones(5), "too few recordings to rank: 5.0 effective units, fewer than 6"),
    "uneven units": (
        "all",
        99.0,
        [9, 1, 1, 1, 1, 1, 1],
        "too few recordings to rank: 2.6 effective units, fewer than 6",
    ),
    "a unit of more than a quarter": ("ids", 99.0, [9, *[2] * 13], "one unit has more than 25% of the weight"),
    "a quarter, up to rounding": ("ids", 99.0, [0.2, *[0.1] * 6], None),
    "on all targets it may": ("all", 99.0, [9, *[2] * 13], None),
    "as many as there must be, up to rounding": ("ids", 20 - 1e-14, [0.1] * 6, None),
    "nothing": ("ids", 0.0, np.zeros(3), "0.0 objects, fewer than 20"),
}


@pytest.mark.parametrize(("subset", "objects", "weight", "why"), SUBSETS.values(), ids=SUBSETS.keys())
def test_what_is_ranked(subset: str, objects: float, weight: list[float], why: str | None) -> None:
    assert why_not_on(subset, objects, weight) == why


@pytest.mark.parametrize(
    ("error", "limits", "ranked"),
    [
        (1.0, (1.0,), True),
        (1.01, (1.0,), False),
        (1.0, (2.0, 0.9), False),
        (1.0, (None, 2.0), True),
        (None, (1.0,), True),
    ],
)
def test_event_subsets_rank_only_who_is_no_worse_than_stp_over_all(
    error: float | None, limits: tuple[float | None, ...], ranked: bool
) -> None:
    assert (guard(error, *limits) is None) == ranked
