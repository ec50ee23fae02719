"""Confidences that do not come true: the mean, and what chance explains."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mtp_bench.scoring.details import misstated
from mtp_bench.scoring.score import Outcome


def table(
    confidence: float, matched: float, n: int, frames: int, complete: bool = True, neutral: int = 0, near: bool = True
) -> Any:
    """A run of one unit with n forecasts, of which the share ``matched`` is of a true object; ``near`` the target."""
    right = round(matched * n)
    outcome = [Outcome.TARGET] * right + [Outcome.FALSE_POSITIVE] * (n - right) + [Outcome.NEUTRAL] * neutral
    score = SimpleNamespace(
        outcome=np.array(outcome),
        cuts=SimpleNamespace(confidence=np.full(len(outcome), confidence, dtype=np.float32)),
        live=frames,
        units=1,
    )
    return SimpleNamespace(covered=np.array([float(near)]), complete=complete, setting=SimpleNamespace(seeds=[[score]]))


CASES = {
    "overstated": (table(0.99, 0.62, 200, 20), True),
    "understated": (table(0.2, 0.9, 200, 20), True),
    "agrees": (table(0.9, 0.9, 200, 20), False),
    "off by less than .05": (table(0.99, 0.95, 100_000, 20), False),
    "chance: few forecasts": (table(0.5, 0.75, 16, 4), False),
    "the same share of many": (table(0.5, 0.75, 1600, 4), True),
    "repeated in 40 frames: chance": (table(0.5, 0.75, 160, 40), False),
    "false ones unknown": (table(0.99, 0.62, 200, 20, complete=False), False),
    "neutral ones are left out": (table(0.9, 0.9, 200, 20, neutral=200), False),
    "far from all targets": (table(0.99, 0.0, 200, 20, near=False), False),
    "no forecast": (table(0.9, 0.9, 0, 20), False),
}


@pytest.mark.parametrize(("given", "said"), CASES.values(), ids=CASES)
def test_confidences_that_do_not_come_true(given: Any, said: bool) -> None:
    means = misstated(given)
    assert (means is not None) == said
    if means is not None:
        outcome = given.setting.seeds[0][0].outcome
        assert means[1] == pytest.approx((outcome == Outcome.TARGET).mean())
