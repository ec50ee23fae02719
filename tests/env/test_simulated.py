"""Environments of simulated traffic, as a user meets them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv, load_submission
from mtp_bench.agent.loader import SubmissionFactory
from mtp_bench.core.bundle import baseline_names, bundled
from mtp_bench.core.errors import MtpBenchError, SubmissionError
from mtp_bench.scoring import SceneScore, score_scene
from tests.support.command_line import CommandLine
from tests.support.runs import run_scenes

SIMULATED = ("MTP-Intersection-v0", "MTP-Roundabout-v0", "MTP-Merge-v0", "MTP-Highway-v0")


def first_scene(env_id: str, **keywords: Any) -> MTPEnv:
    """The env with nothing but its first scene, the same in all tests: it is generated once."""
    return MTPEnv(env_id, scenes=MTPEnv(env_id).scene_names[:1], **keywords)


@pytest.mark.parametrize("env_id", SIMULATED)
def test_the_scene_is_what_the_card_says(env_id: str) -> None:
    env = first_scene(env_id)
    observation, _ = env.reset()
    scene, rate = env.scene, env.card.task.rate
    assert scene.frames == 20 * rate
    assert scene.truth_complete
    assert "simulated" in scene.detector
    assert len(scene.lanes) >= 4
    assert len(env.scene_names) == 1
    # Nothing overflows, and there is something to follow.
    assert 3 < len(scene.detections.score) / scene.frames < 0.8 * env.task.detections
    assert np.isnan(scene.detections.velocity).all() != env.task.velocity
    moved = np.linalg.norm(scene.ego[-1, :2] - scene.ego[0, :2])
    assert (moved > 5) == (env_id != "MTP-Roundabout-v0"), "a roadside sensor stays, an ego drives"
    assert observation["detection_valid"].any()


def shown(env: MTPEnv, seed: int) -> np.ndarray[Any, Any]:
    observation, _ = env.reset(seed=seed)
    return observation["detection_box"]


def test_a_scene_has_the_same_detections_in_every_episode_unless_noise_is_fresh() -> None:
    usual, fresh = (first_scene("MTP-Intersection-v0", fresh_noise=value) for value in (False, True))
    np.testing.assert_array_equal(shown(usual, 0), shown(usual, 1))
    np.testing.assert_array_equal(shown(fresh, 1), shown(fresh, 1))
    assert not np.array_equal(shown(fresh, 0), shown(fresh, 1))
    with pytest.raises(MtpBenchError, match="fresh_noise is for training"):
        MTPEnv("MTP-Merge-v0", fresh_noise=True, evaluation=True)


def test_another_detector_sees_the_same_world() -> None:
    usual, clean = (first_scene("MTP-Intersection-v0", **k) for k in ({}, {"detector": "clean"}))
    for env in (usual, clean):
        env.reset()
    np.testing.assert_array_equal(usual.scene.truth.box, clean.scene.truth.box)
    assert (clean.task.detector, len(clean.scene.detections.box)) == ("clean", len(clean.scene.truth.box))
    order = np.lexsort(clean.scene.detections.box.T), np.lexsort(clean.scene.truth.box.T)
    np.testing.assert_allclose(clean.scene.detections.box[order[0]], clean.scene.truth.box[order[1]], atol=1e-6)
    assert len(usual.scene.detections.box) != len(usual.scene.truth.box)


def scores(env_id: str, scenes: int, agent: str = "stp", **keywords: Any) -> list[SceneScore]:
    submission = load_submission(agent)
    make = SubmissionFactory(str(submission.path), submission.parameters)
    names = MTPEnv(env_id, split=keywords.get("split")).scene_names[:scenes]
    return run_scenes(make, env_id, keywords, names, finish=score_scene)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("cards")
    cards = {}
    for env_id, seconds in (("MTP-Intersection-v0", 10.0), ("MTP-Merge-v0", 4.0)):
        path = folder / f"{env_id}.toml"
        text = (bundled("envs") / path.name).read_text()
        path.write_text(text.replace("seconds = 20.0", f"seconds = {seconds}"))
        cards[env_id] = str(path)
    return cards


TRAINED_FIRST = {"MTP-Intersection-v0": (), "MTP-Merge-v0": ("tracking_free", "affinity")}


@pytest.fixture(autouse=True)
def _no_weights_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path / "weights"))


@pytest.mark.parametrize("env_id", ["MTP-Intersection-v0", "MTP-Merge-v0"])
@pytest.mark.parametrize("name", baseline_names())
def test_every_baseline_runs(name: str, env_id: str, short: dict[str, str]) -> None:
    """Out of the box, or it says what it needs: lanes, or weights (the table in baselines/README.md)."""
    observe = load_submission(name).compare.observe
    if observe == "tracks":
        with pytest.raises(MtpBenchError, match="observe is 'tracks' and tracks is None"):
            scores(short[env_id], 1, name, observe=observe)
        return
    if name in (*TRAINED_FIRST[env_id], "mtp_modes_lanes"):
        with pytest.raises(SubmissionError, match=r"mtp-bench train predictor|shows no lanes"):
            scores(short[env_id], 1, name, observe=observe)
        return
    (score,) = scores(short[env_id], 1, name, observe=observe)
    assert len(score) > 10
    assert (score.invalid.sum(), score.covered.mean() > 0.5) == (0, name != "blind")


def test_a_run_of_another_split_and_detector_is_scored_as_such(cli: CommandLine, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    options = ("--split", "test", "--detector", "iid", "--scenes", "1")
    cli("run", "stp", "--env", "MTP-Roundabout-v0", "-o", folder, *options)
    (entry,) = json.loads((folder / "run.json").read_text())["scenes"]
    assert entry["scene"] == "roundabout-020000"
    scored = tmp_path / "score.json"
    assert cli("score", folder, "--json", scored).status == 0
    whole = next(row for row in json.loads(scored.read_text())["rows"] if row["subset"] == "all")
    (direct,) = scores("MTP-Roundabout-v0", 1, split="test", detector="iid")
    assert whole["targets"] == len(direct)
