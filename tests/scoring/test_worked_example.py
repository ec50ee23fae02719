"""The worked example of docs/definitions/index.md: its tables, and what the scorer says of them."""

import re
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.core import Floats
from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.scoring.bade import CardBudget, errors_at
from tests.support.scoring_scenes import Thing, at, make_card, make_rollout, make_scene

CARD = make_card()  # cars: gate 2 m, c = 10 m
CARS = {name: (30.0 * i, 0.0) for i, name in enumerate("ABCD")}
MIN_ADE = {"A": 1.0, "B": 3.0, "C": 2.0}
FIVE = [("A", 0.9), ("B", 0.8), ("", 0.7), ("C", 0.6), ("", 0.5)]  # car, or none, and confidence
AGENTS = [
    FIVE,
    [("A", 0.9)],
    [("A", 0.9), ("B", 0.8), ("C", 0.7), ("", 0.6), ("", 0.5)],
    [*FIVE, *[("", 0.95)] * 4],
    [],
]


def score_of(stated: list[tuple[str, float]]) -> SceneScore:
    """Score forecasts of the four cars, which stand, in the one live frame."""
    frames, present = CARD.task.past + CARD.task.future, CARD.task.past - 1
    scene = make_scene([[at(i, xy) for i, xy in enumerate(CARS.values())]] * frames)
    things: list[Thing] = []
    for i, (car, confidence) in enumerate(stated):
        x, y = CARS.get(car, (15.0 + 30 * i, 20.0))
        path = [[(x + MIN_ADE.get(car, 0.0), y)] * CARD.task.future] * CARD.task.samples
        things.append(at(i, (x, y), forecast=path, confidence=confidence))
    said = [things if frame == present else [] for frame in range(frames)]
    return score_scene(scene, make_rollout([[]] * frames, said, samples=CARD.task.samples), CARD)


def errors_of(stated: list[tuple[str, float]]) -> Floats:
    """Mean cost of the four cars at each of the ten budgets, m: up to two false forecasts."""
    score = score_of(stated)
    budgets = CardBudget("MTP-Test-v0", 2, 4).budgets(len(score)).all
    assert budgets == pytest.approx(np.arange(1, 11) / 5)
    return np.asarray(errors_at([score.cuts], budgets).error.mean(axis=1))


@pytest.fixture(scope="module")
def example(repository: Path) -> str:
    page = (repository / "docs/definitions/index.md").read_text(encoding="utf-8")
    return page.partition("## A worked example")[2].partition("\n## ")[0]


def test_the_errors_at_the_budgets(example: str) -> None:
    rows = re.findall(r"^\| ([\d., ]+) \| .* = (\d+) m \|$", example, re.MULTILINE)
    errors = {float(budget): float(error) for budgets, error in rows for budget in budgets.split(",")}
    assert list(errors) == pytest.approx(np.arange(1, 11) / 5)
    assert list(errors.values()) == pytest.approx(errors_of(FIVE))


def test_the_other_agents(example: str) -> None:
    rows = re.findall(r"^\| [^|]+ \| ([\d.]+ m|–) \| ([\d.]+) m \|$", example, re.MULTILINE)
    assert len(rows) == len(AGENTS)
    for stated, (min_ade, bade) in zip(AGENTS, rows, strict=True):
        score = score_of(stated)
        assert errors_of(stated).mean() == pytest.approx(float(bade))
        if score.covered.any():
            assert score.min_ade[score.covered].mean() == pytest.approx(float(min_ade.removesuffix(" m")))
        else:
            assert min_ade == "–"
