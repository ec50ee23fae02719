"""The nuScenes prediction challenge: its metrics against the devkit's, and submissions there and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card, with_split
from mtp_bench.errors import CardError, DataError
from mtp_bench.running import stored
from mtp_bench.running.challenge import export_predictions, score_predictions
from mtp_bench.running.options import RunOptions
from mtp_bench.running.stored import open_run
from mtp_bench.scoring import find_targets
from mtp_bench.scoring.challenge import KS, challenge_errors
from mtp_bench.sources.nuscenes.challenge import Prediction, read_predictions, write_predictions
from mtp_bench.sources.nuscenes.source import NuScenes
from tests.support.command_line import CommandLine

GOLDEN = Path(__file__).parents[1] / "scoring" / "golden"
ENV, SPLIT = "MTP-nuScenes-v0", "train"


def golden() -> tuple[dict[str, Any], dict[str, Any]]:
    """Twelve made-up agents, and what nuscenes-devkit 1.2.0 answers on them."""
    given = json.loads((GOLDEN / "in_pred.json").read_text())
    expected = json.loads((GOLDEN / "expected.json").read_text())["prediction_in_pred_json"]["nuscenes"]
    return given, expected


@pytest.mark.parametrize(
    ("ours", "devkit"), [("MinADEK", "minADE"), ("MinFDEK", "minFDE"), ("MissRateTopK_2", "MissRate_2")]
)
def test_parity_with_the_devkit(ours: str, devkit: str) -> None:
    given, expected = golden()
    arrays = [np.array(given[name]) for name in ("pred", "gt", "prob")]
    means = challenge_errors(list(arrays[0]), list(arrays[1]), list(arrays[2])).means()
    assert means[ours] == pytest.approx([expected[devkit][k] for k in ("1", "5", "10")], abs=1e-12)


def by_loops(modes: Any, truth: Any, probability: Any, k: int) -> tuple[float, float, float]:
    """The devkit's published definitions, written anew: the k most probable modes, each metric's best of them."""
    order = sorted(range(len(modes)), key=lambda m: (probability[m], m), reverse=True)[:k]
    far = [[float(np.hypot(*(np.array(p) - q))) for p, q in zip(modes[m], truth, strict=True)] for m in order]
    return (
        min(sum(path) / len(path) for path in far),
        min(path[-1] for path in far),
        float(all(max(path) >= 2.0 for path in far)),
    )


@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_an_independent_implementation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 26, 30)
    truth = [rng.normal(0, 2, (12, 2)) for _ in counts]
    modes = [true + rng.normal(0, rng.uniform(0.1, 1.5), (n, 12, 2)) for n, true in zip(counts, truth, strict=True)]
    chance = [np.round(rng.dirichlet(np.ones(n)), 1) for n in counts]  # many are equal
    found = challenge_errors(modes, truth, chance)
    for column, k in enumerate(KS):
        wanted = [by_loops(*one, k) for one in zip(modes, truth, chance, strict=True)]
        table = np.stack([found.min_ade, found.min_fde, found.miss])[:, :, column].T
        np.testing.assert_allclose(table, wanted, atol=1e-12)


def test_a_mode_misses_from_two_metres_on_in_any_frame() -> None:
    truth = np.zeros((12, 2))
    for off, missed in ((1.99, 0.0), (2.0, 1.0)):
        mode = truth.copy()
        mode[5, 0] = off
        assert challenge_errors([mode[None]], [truth], [np.ones(1)]).miss.tolist() == [[missed] * 3]


# ---- files


def entry(**changes: Any) -> dict[str, Any]:
    """A prediction of two modes."""
    modes = np.zeros((2, 12, 2)).tolist()
    return {"instance": "i", "sample": "s", "prediction": modes, "probabilities": [0.5, 0.5], **changes}


WRONG: dict[str, tuple[Any, str]] = {  # content, what the error names
    "no list": ({"a": 1}, r"p\.json: expected `array`"),
    "twice": ([entry(), entry()], "entry 1: a second prediction of instance 'i' in sample 's'"),
    "eleven places": ([entry(prediction=np.zeros((2, 11, 2)).tolist())], r"\[0\]\.prediction\[0\].* length >= 12"),
    "no modes": ([entry(prediction=[], probabilities=[])], r"\[0\]\.prediction"),
    "ragged": ([entry(prediction=[[[0, 0]], [[1]]])], r"\[0\]\.prediction\[0\]"),
    "one probability": ([entry(probabilities=[1.0])], "entry 0: 1 probabilities, expected one for each of 2 modes"),
    "below 0": ([entry(probabilities=[-0.5, 1.5])], r"\[0\]\.probabilities\[0\]: expected `float` >= 0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_one_error(case: str, tmp_path: Path) -> None:
    content, message = WRONG[case]
    (tmp_path / "p.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=message):
        list(read_predictions(tmp_path / "p.json"))


def test_predictions_come_back_as_they_were(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    given = [Prediction(f"i{n}", "s", rng.normal(size=(n, 12, 2)), rng.dirichlet(np.ones(n))) for n in (1, 10, 30)]
    with (tmp_path / "p.json").open("w") as file:
        assert write_predictions(file, given) == 3
    found = list(read_predictions(tmp_path / "p.json"))
    for each, other in zip(given[:2], found, strict=False):
        np.testing.assert_allclose(other.modes, each.modes)
        np.testing.assert_allclose(other.probability, each.probability)
    kept = np.sort(np.argsort(-given[2].probability)[:25])  # more than the challenge takes
    np.testing.assert_allclose(found[2].modes, given[2].modes[kept])
    assert found[2].probability.sum() == pytest.approx(1.0)


def test_only_envs_with_official_targets(cli: CommandLine, known: list[str], events_run: Path, tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text("[]")
    message = 'has no official prediction targets, expected a nuScenes env with truth = "targets"'
    assert message in cli("export", "prediction", events_run, *known, "-o", tmp_path / "out.json").error
    with pytest.raises(CardError, match="MTP-KITTI-v0 has no official prediction targets"):
        score_predictions(tmp_path / "p.json", "MTP-KITTI-v0")


# ---- the real list of targets


@pytest.mark.data
def test_a_run_as_a_submission_scores_as_the_run_does(cli: CommandLine, data_root: Path, tmp_path: Path) -> None:
    """With k = 10 its errors are those of the scorer where there is a forecast: the same targets, the same pairs."""
    options = RunOptions(str(data_root), scenes=2, split=SPLIT)
    stored.run("stp", ENV, tmp_path / "run", options)
    opened = open_run(tmp_path / "run", str(data_root))
    done = export_predictions(opened, tmp_path / "p.json")
    row = stored.score(tmp_path / "run", RunOptions(str(data_root))).report.to_json()["rows"][0]
    found = score_predictions(tmp_path / "p.json", ENV, options)
    assert (done.targets, found.targets, found.elsewhere) == (row["targets"], row["targets"], 0)
    assert done.predicted == found.predicted == pytest.approx(row["coverage"] * row["targets"])
    assert found.metrics["MinADEK"][2] == pytest.approx(row["minADE"], abs=1e-6)
    assert found.metrics["MinFDEK"][2] == pytest.approx(row["minFDE"], abs=1e-6)
    said = cli.ok("challenge", tmp_path / "p.json", "--data", data_root, "--split", SPLIT, "--scenes", 2, "--json", "-")
    assert json.loads(said)["metrics"] == found.metrics
    (tmp_path / "p.json").write_text(json.dumps([entry()]))
    with pytest.raises(
        DataError, match=r"none of its 1 predictions is of one of the \d+ targets of this split; choose"
    ):
        score_predictions(tmp_path / "p.json", ENV, options)


@pytest.mark.data
def test_the_truth_itself_has_no_error(data_root: Path, tmp_path: Path) -> None:
    card = with_split(load_card(ENV), SPLIT)
    source = NuScenes(card, data_root)
    scene = source.names[0]
    targets, arrays = find_targets(source.load(scene), card), source.tables.arrays(scene)
    path = tmp_path / "p.json"
    with path.open("w") as file:
        write_predictions(
            file,
            (
                Prediction(str(arrays["instance"][i]), str(arrays["sample"][t]), true[None], np.ones(1))
                for i, t, true in zip(targets.object_id, targets.frame, targets.future, strict=True)
            ),
        )
    options = RunOptions(str(data_root), scenes=1, split=SPLIT)
    found = score_predictions(path, ENV, options)
    assert found.predicted == found.targets == len(targets)
    for values in found.metrics.values():
        assert values == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    listed = json.loads((data_root / "nuscenes/maps/prediction/prediction_scenes.json").read_text())[scene]
    assert {f"{each.instance}_{each.sample}" for each in read_predictions(path)} == set(listed)
