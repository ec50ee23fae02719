"""The product's ranks, gaps and intervals against the independent ones, on drawn scenes."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mtp_bench.core import Floats, Ints, Rollout, Scene
from mtp_bench.scoring import SUBSETS, AgentScores, Reference, References, statistics, summarise
from mtp_bench.scoring.table import agent_table
from mtp_bench.scoring.targets import units
from tests.independent import scorer
from tests.independent.scorer import BESIDE, Draws, Own, Scored
from tests.independent.statistics import blocks_of
from tests.independent.test_agreement import RUNS, agent_scores, drawn, reference_of, rows_of, said, same
from tests.support.scoring_scenes import make_card, take_objects
from tests.support.source_files import with_task

# A scene is a unit; beyond 14 units the flips are drawn. The last has 10 scenes as case 3, of which one weighs most.
CASES, SCENES = (0, 3, 4, 8), (4, 7, 8, 10, 15)
REASONS = {  # in the independent scorer's words -> in the product's
    "shown, not ranked": "shown only",
    "too few recordings to rank": "too few recordings",
    "too few objects": "objects, fewer than 20",
    "one unit is more than a quarter": "one unit has more than 25% of the weight",
    "true pasts": "saw the truth",
    "more samples than k": "8 samples per object",
    "worse than STP on all": "over all targets its bADE is above that of stp",
}


PLAYERS = {  # metres of their forecasts beside those that are drawn, and the share of them that they leave out
    "stp": (1.0, 0.0), "gt": (0.2, 0.0), "good": (0.7, 0.0), "alike": (1.0, 0.05), "bad": (1.3, 0.1),
    "free": (0.3, 0.0), "bad's equal": (1.3, 0.1), "good's stp": (1.1, 0.02), "good's gt": (0.3, 0.0),
    "good's same": (1.05, 0.0), "good's associated": (0.8, 0.02),
}  # fmt: skip
OWN = {"single": "good's stp", "ground_truth": "good's gt"}
OWN |= {"same_samples": "good's same", "associated_same_samples": "good's associated"}


@lru_cache
def from_counts(n: int) -> Ints:
    """The product's resamples as indices of the units."""
    return np.array([np.repeat(np.arange(n), counts) for counts in statistics._resamples(n).astype(int)])


def as_flipped(n: int) -> Floats:
    return np.random.default_rng(statistics._SEED).choice([-1.0, 1.0], size=(statistics.FLIPS, n))


@lru_cache(maxsize=max(SCENES))
def before(seed: int, place: int) -> Rollout:
    """The rollout from which those of all players are made."""
    return said("simulated", seed, place, 0)


def of_player(beside: float, silent: float, seed: int, scene: Scene, place: int) -> Rollout:
    rollout = before(seed, place)
    rng = np.random.default_rng([seed, place, int(1000 * silent)])
    kept = np.flatnonzero(rng.random(len(rollout.object_box)) >= silent)
    forecast = rollout.forecast + np.array([0, 100 * beside], dtype=np.int16)
    return replace(take_objects(replace(rollout, forecast=forecast), kept), scene=scene.name)


def unlike(reference: Reference, seed: int) -> Reference:
    """Weights of which one scene has most in every second case."""
    if seed % 2:
        return reference
    first = next(iter(reference.scenes))
    part = reference.scenes[first]
    heavy = replace(part, counts=np.minimum(4 * part.counts, RUNS).astype(np.uint8))
    return replace(reference, scenes={**reference.scenes, first: heavy})


@pytest.mark.parametrize("rate", [2.0, 7.0, 10.0])
def test_both_cut_scenes_into_the_same_blocks(rate: float) -> None:
    empty = drawn("simulated", 0, 0)
    for frames in range(2, 1000):
        time = 1000.0 + np.arange(frames) / rate
        found = units(replace(empty, time=time), with_task(make_card(), rate=rate))
        assert found.tolist() == [t * blocks_of(frames, rate) // frames for t in range(frames)]


@pytest.mark.parametrize("seed", CASES)
def test_both_scorers_rank_alike(seed: int) -> None:
    card = make_card()
    scenes = [drawn("simulated", seed, place) for place in range(SCENES[seed % len(SCENES)])]
    reference = unlike(reference_of(card, scenes, seed), seed)
    constants = (reference.budget.forecasts, reference.budget.divisor)
    product: dict[str, AgentScores] = {}
    others: dict[str, Scored] = {}
    for name, player in PLAYERS.items():
        runs = [[of_player(*player, seed, scene, place) for place, scene in enumerate(scenes)]]
        observe = "truth" if name.endswith("gt") else "detections"
        product[name] = replace(agent_scores(name, scenes, runs, card), observe=observe)
        if name == "free":
            eight = tuple(tuple(replace(score, samples=8) for score in run) for run in product[name].seeds)
            product[name] = replace(product[name], budget="free", samples=8, seeds=eight)
        table = agent_table(product[name], reference)
        weights = {subset: weight for subset, weight in table.weight.items() if subset != "all"}
        others[name] = scorer.score(card, scenes, runs, constants, weights)
    kinematic = {"single": product["stp"], "ground_truth": product["gt"]}
    own = {role: product[name] for role, name in OWN.items()}
    ends = {"good": References(**own), "alike": References(**kinematic), "bad": None}
    rows = [agent for name, agent in product.items() if name not in OWN.values()]
    report = summarise(rows, card, reference, stp="stp", truth="gt", references=ends)
    compared = scorer.compare(
        {name: agent for name, agent in others.items() if name not in OWN.values()},
        own={
            "good": Own(*(others[name] for name in OWN.values())),
            "alike": Own(others["stp"], others["gt"]),
            "bad": Own(),
        },
        free=("free",),
        draws=Draws(from_counts, as_flipped),
    )
    for subset in SUBSETS:
        for name, values in compared[subset].items():
            row = rows_of(report, name)[subset]
            same(row, values, ("place", "rank_range", "interval", *BESIDE))
            reason, told = values["unranked_because"], row["unranked_because"]
            assert REASONS[reason] in told if reason else told is None, (name, subset)
