"""Scenes of real recordings, written as own scenes: agents say the same on them and score the same, to the bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import MTPEnv, load_submission
from mtp_bench.cards import Card, load_card, with_files, with_scenes
from mtp_bench.core import Rollout, Scene
from mtp_bench.env.rollouts import digest
from mtp_bench.running.playing import run_scene
from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.sources import load_scenes
from mtp_bench.sources.files.save import save_scene
from tests.support.own_scenes import assert_same

SCENES = {
    "MTP-KITTI-v0": "0006", "MTP-KITTI-noego-v0": "0012", "MTP-nuScenes-mini-v0": "scene-0061", "MTP-PETS-v0": None,
    "MTP-WILDTRACK-v0": None,
}  # fmt: skip


def played(card: Card, name: str, data: str) -> tuple[Scene, Rollout, SceneScore]:
    """What stp says of a scene, and what that is worth."""
    env = MTPEnv(card, data)
    rollout = run_scene(load_submission("stp").build(env.task), env, name, 0)
    return env.scene, rollout, score_scene(env.scene, rollout, card)


def assert_scores_alike(first: SceneScore, second: SceneScore) -> None:
    """All arrays of two scores are equal, but for the time that the agent took."""
    for name, value in vars(first).items():
        if isinstance(value, np.ndarray) and name != "seconds":
            np.testing.assert_array_equal(value, getattr(second, name), err_msg=name)
    assert first.detections == second.detections


@pytest.mark.data
@pytest.mark.parametrize(("env_id", "name"), SCENES.items())
def test_a_recording_in_memory_scores_as_its_original(env_id: str, name: str | None, data_root: Path) -> None:
    card, data = load_card(env_id), str(data_root)
    scene = next(load_scenes(card, data, None if name is None else [name]))
    own = with_scenes(card, [scene])
    original, said, score = played(card, scene.name, data)
    found, rollout, found_score = played(own, scene.name, data)
    assert_same(found, original)
    assert digest(rollout) == digest(said)
    assert_scores_alike(found_score, score)
    assert own.digest != card.digest


@pytest.mark.data
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_tables_of_a_recording_score_as_its_original(form: str, tmp_path: Path, data_root: Path) -> None:
    card, data = load_card("MTP-nuScenes-mini-v0"), str(data_root)
    (scene,) = load_scenes(card, data, ["scene-0553"])
    save_scene(scene, tmp_path, card.task.classes, form)  # type: ignore[arg-type]
    _, said, score = played(card, scene.name, data)
    found, rollout, found_score = played(with_files(card, tmp_path), scene.name, data)
    assert digest(rollout) == digest(said)
    names = [found.name_of(number) for number in found_score.object_id.tolist()]
    assert names == [scene.name_of(number) for number in score.object_id.tolist()]
    assert_scores_alike(replace(found_score, object_id=score.object_id), score)
    assert found.detector == scene.detector
