"""Official numbers: hand-made scenes with values worked out in comments, and what the official scripts printed."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.core import CardError
from mtp_bench.running import open_run, run
from mtp_bench.running.official import official_scores, require_nuscenes
from mtp_bench.running.options import RunOptions
from mtp_bench.scoring import OfficialRow, official_rows, official_scene
from mtp_bench.scoring.official import OfficialScene
from mtp_bench.sources.nuscenes.layout import official_scenes
from tests.support.command_line import CommandLine
from tests.support.scoring_scenes import WALKER, Thing, at, make_rollout, make_scene

CLASSES = ("car", "pedestrian")
STEPS = 12


def drive(x: float, y: float, speed: float = 0.0) -> np.ndarray[Any, Any]:
    """Twelve places ahead of (x, y), ``speed`` metres apart along x; one sample."""
    return np.stack([x + speed * np.arange(1, STEPS + 1), np.full(STEPS, y)], axis=1)[None]


def numbers(*scenes: OfficialScene) -> dict[str, float | None]:
    return {row.number: None if row.value is None else round(row.value, 4) for row in official_rows("one", scenes)}


def counted(
    truth: list[list[Thing]], said: list[list[Thing]], names: tuple[str, ...] = CLASSES, seconds: float = 0.5
) -> OfficialScene:
    """The scene with one sample per forecast; ``names`` of the true classes."""
    scene = make_scene(truth)
    scene = replace(scene, time=seconds * np.arange(scene.frames))
    rollout = make_rollout([], [*said, *[[]] * (scene.frames - len(said))], future=STEPS)
    return official_scene(rollout, CLASSES, scene, scene.truth, np.array(names)[scene.truth.class_id])


def present(*things: Thing) -> list[list[Thing]]:
    """Thirteen frames in which cars stand: eligible in the first one alone, as a list names them."""
    return [list(things), *[[replace(thing, eligible=False) for thing in things]] * STEPS]


# A car stands at (10, 0) and is on the list. Forecasts of frame 0: it creeps .25 m a step (3 m off at the end, a mean of
# 1.625 m), and a false one at (30, 0) with half the confidence.
CREEPS = at(0, (10, 0), forecast=drive(10, 0, 0.25), confidence=0.8)
FALSE = at(0, (30, 0), forecast=drive(30, 0), confidence=0.4)


def test_one_hit_one_false_forecast_and_one_miss() -> None:
    # a second car at (-10, 0), on the list, has no forecast
    scene = counted(present(at(1, (10, 0)), at(2, (-10, 0))), [[CREEPS, FALSE]])
    assert scene.targets["car"] == 2
    result = numbers(scene)
    assert (result["MFEval minADE, m"], result["MFEval minFDE, m"], result["MFEval MR"]) == (1.625, 3.0, 0.0)
    # car: precision 1 at the recalls .11 to .49, and .5 at .5, where both forecasts are kept; less .1, over 90 recalls
    # and .9. Bus and truck have 0.
    assert result["MFEval mAPf"] == pytest.approx((39 * 0.9 + 0.4) / 90 / 0.9 / 3, abs=1e-4)
    # UniAD counts the two cars in 13 frames. 3 m off at the end is not a hit, nor false, as the car is matched.
    assert result["UniAD EPA, car, from 0.0"] == round(-0.5 / 26, 4)
    assert result["UniAD EPA, car, from 0.5"] == 0.0
    assert result["UniAD EPA, pedestrian, from 0.0"] is None  # no pedestrian


def test_a_hit_of_uniad_ends_within_two_metres_of_the_last_known_place() -> None:
    # the walker is there for 4 more frames; in the last frames it has no future, so it cannot be hit
    walker = at(1, (0, 5), class_id=WALKER)
    said = [[at(0, (0, 5), class_id=WALKER, forecast=drive(0, 5, 0.45))], [], [], [],
            [at(0, (0, 5), class_id=WALKER, forecast=drive(0, 5))]]  # fmt: skip
    result = numbers(counted([[walker]] * 5, said))
    assert result["UniAD EPA, pedestrian, from 0.0"] == round(1 / 5, 4), "4 steps of .45 m are 1.8 m"


def test_targets_of_uniad_end_at_their_reach() -> None:
    scene = counted(
        [[at(1, (49, 0)), at(2, (51, 0)), at(3, (0, 41), class_id=WALKER), at(4, (5, 5), neutral=True)]], [[]]
    )
    assert (scene.targets["UniAD EPA, car"], scene.targets["UniAD EPA, pedestrian"]) == (1, 0)


def test_classes_are_merged() -> None:
    # names of the true classes: the second one is a motorcycle, which counts as a car; a cone does not
    frames = [[at(1, (5, 0)), at(2, (5, 5), class_id=WALKER)]]
    assert counted(frames, [[]], names=("car", "motorcycle")).targets["UniAD EPA, car"] == 2
    assert counted(frames, [[]], names=("car", "traffic_cone")).targets["UniAD EPA, car"] == 1


def test_the_most_confident_forecast_takes_the_nearest_free_object() -> None:
    # both forecasts are within 2 m of car 1; the sure one takes it, and the other one is false though it is nearer
    sure = at(0, (11, 0), forecast=drive(11, 0), confidence=0.9)
    nearer = at(0, (10.1, 0), forecast=drive(10.1, 0), confidence=0.6)
    result = numbers(counted(present(at(1, (10, 0))), [[nearer, sure]]))
    assert result["UniAD EPA, car, from 0.5"] == round((1 - 0.5) / 13, 4)
    # MFEval keeps the forecasts from .9 on: the error is that of the sure one
    assert result["MFEval minADE, m"] == 1.0


def test_a_forecast_that_goes_astray_leaves_its_object_to_the_next() -> None:
    astray = at(0, (10, 0), forecast=drive(10, 0, 5.0), confidence=0.9)  # 60 m off at the end
    good = at(0, (10.5, 0), forecast=drive(10.5, 0), confidence=0.8)
    result = numbers(counted(present(at(1, (10, 0))), [[astray, good]]))
    # astray: matched for detection, so the good one is false; the good one is the hit
    assert result["UniAD EPA, car, from 0.5"] == round((1 - 0.5) / 13, 4)
    # F1 is best with both; of the two, the nearest one is matched: it ends 60 m off
    assert (result["MFEval minFDE, m"], result["MFEval MR"]) == (60.0, 1.0)


def test_mfeval_leaves_out_forecasts_of_vehicles_off_the_list() -> None:
    # car 2 is not on the list: its forecast is not false. FALSE has no object.
    truth = present(at(1, (10, 0)), at(2, (20, 0), eligible=False))
    other = at(0, (20, 0), forecast=drive(20, 0), confidence=0.99)
    scene = counted(truth, [[CREEPS, other, FALSE]])
    assert scene.forecasts.mfeval_class.tolist() == ["car", "", "car"]
    # nor are forecasts of frames without a listed target counted
    scene = counted(truth, [[CREEPS], [CREEPS]])
    assert scene.forecasts.mfeval_class.tolist() == ["car", ""]


def test_an_absent_sample_is_not_looked_at() -> None:
    said = at(0, (10, 0), forecast=np.concatenate([drive(10, 0, 0.25), drive(10, 0)]), log_weight=[0.0, -np.inf])
    scene = make_scene(present(at(1, (10, 0))))
    rollout = make_rollout([], [[said], *[[]] * STEPS], samples=2, future=STEPS)
    seen = official_scene(rollout, CLASSES, scene, scene.truth, np.array(["car"] * 13))
    assert numbers(seen)["MFEval minFDE, m"] == 3.0


def test_scenes_are_counted_together() -> None:
    scene = counted(present(at(1, (10, 0))), [[CREEPS]])
    other = counted(present(at(1, (10, 0))), [[FALSE]])
    result = numbers(scene, other)
    assert result["UniAD EPA, car, from 0.0"] == round(-0.5 / 26, 4)
    assert result["MFEval minADE, m"] == 1.625


def test_nothing_to_count() -> None:
    result = numbers(counted([[]], [[]]))
    assert result["MFEval mAPf"] == 0.0
    assert {value for number, value in result.items() if number != "MFEval mAPf"} == {None}


@pytest.mark.parametrize("env", ["MTP-KITTI-v0", "MTP-AV2-v0"])
def test_other_data_has_no_official_numbers(env: str) -> None:
    with pytest.raises(CardError, match=f"{env} has .* steps of .*, expected 12 of nuScenes"):
        require_nuscenes(load_card(env))


ENV = "MTP-nuScenes-mini-v0"
# printed by MFEval's eval.py, rounded to three digits: minADE, minFDE, MR_matched, mAPf of "all"
MFEVAL = {
    ("stp", "mini_val"): [4.547, 10.05, 0.588, 0.01], ("stp", "mini_train"): [4.464, 10.132, 0.639, 0.008],
    ("mtp", "mini_val"): [4.59, 10.04, 0.632, 0.015], ("mtp", "mini_train"): [3.815, 8.671, 0.578, 0.013],
}  # fmt: skip
# by an independent script from UniAD's published code, rounded to three digits: car and pedestrian, from 0, .3 and .5 on
UNIAD: dict[str, list[float | None]] = {
    "stp": [-0.169, 0.547, 0.521, 0.394, 0.680, 0.686],
    "mtp": [None, 0.577, 0.551, None, 0.695, 0.698],
}


@pytest.mark.data
@pytest.mark.parametrize("agent", ["stp", "mtp"])
def test_the_numbers_of_the_official_scripts(agent: str, data_root: Path, tmp_path: Path, cli: CommandLine) -> None:
    run(agent, ENV, tmp_path / "run", RunOptions(str(data_root)))
    if agent == "stp":
        content = json.loads(cli.ok("score", tmp_path / "run", "--data", data_root, "--official", "--json", "-"))
        assert content["official"][5] == {
            "agent": "stp",
            "number": "UniAD EPA, car, from 0.3",
            "targets": 7377,
            "value": pytest.approx(0.547, abs=0.00051),
        }
        printed = cli.ok("score", tmp_path / "run", "--data", data_root, "--official")
        assert "\nOfficial numbers\n" in printed
        assert "stp   UniAD EPA, car, from 0.3           7377  0.547\n" in printed
    opened = open_run(tmp_path / "run", str(data_root))
    values = [row.value for row in official_scores(opened)[4:]]
    for value, expected in zip(values, UNIAD[agent], strict=True):
        # .5 of the last printed digit, and the rounding of a number that ends in 5
        assert expected is None or value == pytest.approx(expected, abs=0.00051)
    for split, targets in (("mini_val", 61), ("mini_train", 742)):
        names = official_scenes()[split]
        kept = tuple(rollout for rollout in opened.run.rollouts if rollout.scene in names)
        part = replace(opened, run=replace(opened.run, rollouts=kept))
        rows = official_scores(part)[:4]
        assert {row.targets for row in rows} == {targets}
        assert [row.value for row in rows] == pytest.approx(MFEVAL[agent, split], abs=0.00051)


def test_rows_are_json() -> None:
    rows = official_rows("one", [counted(present(at(1, (10, 0))), [[CREEPS]])])
    assert json.loads(json.dumps([row.model_dump() for row in rows]))[0] == {
        "agent": "one", "number": "MFEval minADE, m", "targets": 1, "value": 1.625
    }  # fmt: skip
    assert isinstance(rows[0], OfficialRow)
