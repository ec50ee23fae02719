"""Parts of bADE by hand: each is what its name says; tests/independent computes them anew on random rollouts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.scoring import AgentScores, References, score_scene, summarise
from mtp_bench.scoring.parts import PART_NAMES
from mtp_bench.scoring.rows import Row
from mtp_bench.scoring.targets import AbsentCause
from tests.support.scoring_scenes import WALKER, Thing, make_card, make_rollout, make_scene, with_detections

SMALL = make_card(past=2, future=3, samples=1)
REFERENCES = ("ground_truth", "localisation", "history", "association")


def still(x: float, y: float = 0.0) -> Any:
    return np.tile([x, y], (1, 3, 1))


def costs(
    objects: list[Thing], detected: list[list[Thing]], said: list[Thing], *others: list[Thing], samples: int = 1
) -> dict[str, Any]:
    """Parts that are above 0, of objects at rest whose only targets are in frame 1; ``others``: what references say."""
    scene = with_detections(make_scene([objects] * 5), [*detected, [], [], []])

    def scores(forecasts: list[Thing], samples: int = 1) -> AgentScores:
        score = score_scene(scene, make_rollout([[]] * 5, [[], forecasts], samples=1), SMALL)
        return AgentScores("x", 1, samples, "equal", ((replace(score, samples=samples),),))

    runs = (scores(other, samples) for other in others)
    references = {"x": References(associated=next(runs), tracks=next(runs))} if others else {}
    row = next(row for row in summarise([scores(said)], SMALL, references=references).rows if row.subset == "all")
    values = {name: getattr(row, f"cost_{key}") for key, name in PART_NAMES.items()}
    assert sum(value or 0.0 for value in values.values()) == pytest.approx(row.error, abs=1e-9)
    return {name: round(value, 6) for name, value in values.items() if value}


def test_every_cost_of_a_row_has_a_printed_name() -> None:
    assert {f"cost_{part}" for part in PART_NAMES} == {name for name in Row.model_fields if name.startswith("cost_")}
    assert set(PART_NAMES) == {*REFERENCES, "rest", "below_threshold", *(cause.name.lower() for cause in AbsentCause)}


CAR, BESIDE = Thing(1, 0, 0), Thing(1, 3, 0)
CAUSES: dict[str, list[list[Thing]]] = {  # detections of a car at 0 in frames 0 and 1
    "no forecast": [[], [Thing(1, 2, 0)]],  # the gate is 2 m, inclusive
    "other class": [[], [Thing(1, 2, 0, class_id=WALKER), BESIDE]],
    "off place": [[CAR], [BESIDE]],
    "never detected so far": [[BESIDE], [Thing(1, 4.1, 0)]],
    "not detected now": [[CAR], []],
}


@pytest.mark.parametrize("cause", CAUSES)
def test_the_first_cause_of_a_missing_forecast(cause: str) -> None:
    assert costs([CAR], CAUSES[cause], []) == {cause: 10.0}


def test_the_parts_of_a_forecast() -> None:
    # it starts 1 m beside the car and ends 2.5 m off; with perfect association it starts 1 m off and stays there,
    # on ground-truth tracks it is .25 m off
    said, associated = Thing(1, 1, 0, forecast=still(2.5)), Thing(1, 1, 0, forecast=still(1))
    tracks = Thing(1, 0, 0, forecast=still(0.25))
    split = costs([CAR], [[], [CAR]], [said], [associated], [tracks])
    assert split == {"predictor": 0.25, "localisation": 1.0, "history": -0.25, "association": 1.5}
    for others in ([[associated], []], [[], [tracks]], []):  # type: list[list[Thing]]
        assert costs([CAR], [[], [CAR]], [said], *others) == {"rest": 2.5}
    assert costs([CAR], [[], [CAR]], [said], [associated], [tracks], samples=2) == {"rest": 2.5}  # another number
