"""Trackers of other packages as submissions: `trackers` (Roboflow) and `motpy`, which follow boxes of images."""

import importlib.util
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import MTPEnv, load_submission
from mtp_bench.running import check_agent
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.stored import run
from mtp_bench.scoring import SceneScore, score_scene
from tests.support.small_scenes import CARD_ID

CASES = {
    "SORT": ("trackers_sort", {"tracker": "SORTTracker"}, "trackers"),
    "ByteTrack": ("trackers_sort", {"tracker": "ByteTrackTracker"}, "trackers"),
    "motpy": ("motpy_tracker", {}, "motpy"),
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest, repository: Path) -> tuple[Path, dict[str, str]]:
    """Folder and parameters of a submission whose package is there."""
    folder, parameters, package = CASES[request.param]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed: pip install '.[trackers]'")
    return repository / "examples" / folder, dict(parameters)


def test_it_keeps_the_contract(case: tuple[Path, dict[str, str]], card: str, kitti: str) -> None:
    folder, parameters = case
    env = MTPEnv(card, kitti)
    findings = check_agent(
        lambda task: load_submission(folder).build(task, **parameters), card, env.scene_names[:2], {"data": kitti}
    )
    assert [finding for finding in findings if finding.level == "error"] == []


def test_it_follows_the_cars(case: tuple[Path, dict[str, str]], card: str, kitti: str) -> None:
    # Two cars and a pedestrian, without detections in frames 3 and 4: the same ids before and after. The pedestrian's
    # scores are too low for ByteTrack to start a track.
    folder, parameters = case
    env = MTPEnv(card, kitti)
    rollout = run_scene(load_submission(folder).build(agent_task(env, 0), **parameters), env, "0001", 0)
    first, last = rollout.tracks.rows(2), rollout.tracks.rows(8)
    names = {tuple(sorted(rollout.track_id[rows].tolist())) for rows in (first, last)}
    assert len(names) == 1
    count = 2 if parameters.get("tracker") == "ByteTrackTracker" else 3
    assert len(names.pop()) == len(np.unique(rollout.track_id)) == count


def test_the_command_runs_it(case: tuple[Path, dict[str, str]], card: str, kitti: str, tmp_path: Path) -> None:
    folder, _ = case
    assert run(folder, card, tmp_path / "run", RunOptions(kitti, scenes=1)).scenes == 1
    assert CARD_ID in (tmp_path / "run/run.json").read_text()


def _scored(env: MTPEnv, scene: str, folder: str | Path, parameters: dict[str, str]) -> SceneScore:
    rollout = run_scene(load_submission(folder).build(agent_task(env, 0), **parameters), env, scene, 0)
    return score_scene(env.scene, rollout, env.card)


@lru_cache
def _real(env_id: str, scene: str, data_root: Path) -> tuple[MTPEnv, SceneScore]:
    env = MTPEnv(env_id, str(data_root), evaluation=True)
    return env, _scored(env, scene, "stp", {})


@pytest.mark.data
@pytest.mark.parametrize(("env_id", "scene"), [("MTP-nuScenes-mini-v0", "scene-0103"), ("MTP-KITTI-v0", "0012")])
def test_it_tracks_real_scenes(env_id: str, scene: str, case: tuple[Path, dict[str, str]], data_root: Path) -> None:
    folder, parameters = case
    env, ours = _real(env_id, scene, data_root)
    theirs = _scored(env, scene, folder, parameters)
    assert theirs.invalid.sum() == 0
    assert theirs.covered.mean() > 0.5 * ours.covered.mean()
    assert np.median(theirs.min_ade[theirs.covered]) < 2 * np.median(ours.min_ade[ours.covered])
    assert theirs.counts.tp.sum() > 0
    assert theirs.counts.ids.sum() < 0.1 * theirs.counts.tp.sum()
