"""Who is ranked, on what, and in which order."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import ArrayLike

from mtp_bench.scoring import rank_by_error
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.rank import Place, guard_reason, why_not_on, why_unranked
from mtp_bench.scoring.statistics import UnitSums


def sums(error: ArrayLike, weight: ArrayLike | None = None, objects: float = 99.0) -> UnitSums:
    """Return sums of units, each of weight 1 unless stated."""
    summed = np.asarray(error, dtype=np.float64)
    return UnitSums(10, np.ones(len(summed)) if weight is None else np.asarray(weight), summed, objects)


class Agent(NamedTuple):
    """An agent with the same sums on each subset."""

    error: ArrayLike

    def sums_on(self, subset: Subset) -> UnitSums:
        return sums(self.error)


def test_places_follow_the_error_and_ranges_the_tests() -> None:
    rng = np.random.default_rng(5)
    unit = rng.normal(10, 3, 15)
    noise = rng.normal(0, 0.5, 15)
    noise -= noise.mean() - 0.001
    agents = [unit + 5.0 + noise, unit + noise, unit, unit + 5.0, unit + 9.0]
    ranks = rank_by_error(agents, np.ones(15))
    assert ranks == [Place(4, (3, 4)), Place(2, (1, 2)), Place(1, (1, 2)), Place(3, (3, 4)), Place(5, (5, 5))]
    assert [rank.rank for rank in ranks] == ["4 (3–4)", "2 (1–2)", "1 (1–2)", "3 (3–4)", "5"]
    assert rank_by_error(np.zeros((0, 4)), np.ones(4)) == []
    assert Place().rank is None


@pytest.mark.parametrize(("units", "least"), [(5, 1), (6, 2)])
def test_five_units_can_never_tell_agents_apart(units: int, least: int) -> None:
    ranks = rank_by_error([np.zeros(units), np.ones(units)], np.ones(units))  # p is 2 / 2^units
    assert ranks == [Place(1, (1, 3 - least)), Place(2, (least, 2))]


def test_rounding_is_no_difference() -> None:
    unit = np.linspace(1.0, 9.0, 8)
    above = np.nextafter(unit, np.inf)  # in every unit: without a tolerance p is 2 / 2^8
    assert rank_by_error([unit, above], np.ones(8)) == [Place(1, (1, 2))] * 2
    difference = sums(above).minus(sums(unit))
    assert difference is not None
    assert difference.p == 1.0
    assert guard_reason(Agent(above), Agent(unit)) is None


@settings(derandomize=True, deadline=None, max_examples=15)
@given(st.integers(0, 10_000))
def test_the_order_of_agents_does_not_matter_and_places_fit_their_ranges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sums, weight = rng.normal(10, 1, (5, 8)) + rng.uniform(0, 3, (5, 1)), rng.uniform(1, 2, 8)
    ranks = rank_by_error(sums, weight)
    order = rng.permutation(5)
    assert rank_by_error(sums[order], weight) == [ranks[i] for i in order]
    assert [rank.place for rank in ranks] == (1 + np.argsort(np.argsort(sums.sum(axis=1)))).tolist()
    assert all(rank.span and rank.place and rank.span[0] <= rank.place <= rank.span[1] for rank in ranks)
    assert rank_by_error(sums - 0.5, weight) == ranks  # everyone, in every unit: nothing changes


ENTRANTS = {
    "honest": (("equal", 10, "detections"), None),
    "true pasts": (("equal", 10, "truth"), "saw the truth"),
    "more samples": (("free", 40, "detections"), "40 samples per object, not the env's own k"),
}


@pytest.mark.parametrize(("entrant", "why"), ENTRANTS.values(), ids=ENTRANTS.keys())
def test_who_is_ranked(entrant: tuple[Any, ...], why: str | None) -> None:
    assert why_unranked(*entrant) == why


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
def test_what_is_ranked(subset: Subset, objects: float, weight: list[float], why: str | None) -> None:
    assert why_not_on(subset, sums(np.zeros(len(weight)), weight, objects)) == why


STEADY, UNSTEADY = np.full(8, 0.02), np.array([0.4, -0.3, 0.2, -0.2, 0.1, -0.1, 0.1, -0.04])


@pytest.mark.parametrize(
    ("gaps", "ranked"),
    [
        ((STEADY,), False),  # 2 %, in every unit
        ((STEADY / 4,), True),  # 0.5 %
        ((UNSTEADY,), True),  # 2 % that no test finds
        ((UNSTEADY + 0.1,), False),  # above 5 %, whatever the test finds
        ((-STEADY, STEADY), False),  # worse than stp with its own predictor
        ((-STEADY, None), True),
        ((None, -STEADY), True),
    ],
)
def test_event_subsets_rank_only_agents_that_are_no_worse_than_stp_over_all(gaps: Any, ranked: bool) -> None:
    error = np.ones(8)
    limits = (None if gap is None else Agent(error / (1 + gap)) for gap in gaps)
    assert (guard_reason(Agent(error), *limits) is None) == ranked
