"""Pictures of identity switches, made by the viewer without a screen: what a person would see is there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench import load_submission
from mtp_bench.env import MTPEnv
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.viz.replay import Replay, replay
from mtp_bench.viz.rerun.colors import BORDER, SWITCH, TRUTH, track_colors
from mtp_bench.viz.rerun.log import save_recording
from mtp_bench.viz.rerun.sdk import ViewerClient
from tests.support.headless_viewer import headless_viewer, near, open_at, picture, require_driver


@pytest.fixture(scope="module")
def viewer() -> Iterator[ViewerClient]:
    require_driver()
    with headless_viewer() as client:
        yield client


def played(env_id: str, agent: str, scene: str | None = None) -> Replay:
    """A baseline on one scene."""
    env = MTPEnv(env_id, evaluation=True)
    name = scene or env.scene_names[0]
    rollout = run_scene(load_submission(agent).build(agent_task(env, 0)), env, name, seed=0)
    return replay(env.scene, rollout, env.card, agent)


def colours(image: NDArray[np.uint8]) -> int:
    """Number of different colours."""
    return len(np.unique(image.reshape(-1, 3), axis=0))


@pytest.mark.parametrize(
    ("env_id", "agent", "scene"),
    [
        ("MTP-Intersection-v0", "stp", None),
        pytest.param("MTP-KITTI-noego-v0", "mtp", "0014", marks=pytest.mark.data),
    ],
)
def test_an_identity_switch_is_seen(
    env_id: str, agent: str, scene: str | None, viewer: ViewerClient, tmp_path: Path
) -> None:
    run = played(env_id, agent, scene)
    switch = run.incident("ids-0")
    save_recording(tmp_path / "switch.rrd", [run], at=switch)
    open_at(viewer, tmp_path / "switch.rrd", switch.frame)
    assert colours(picture(viewer, tmp_path / "window.png")) > 400  # and now every visible view has been drawn
    views = {view.name: view for view in viewer.get_state().views}
    assert not any(view.reports for view in views.values())
    best = f"hypothesis {run.said.hypotheses.best[switch.frame]}"
    for name in ("boxes per frame", "events so far", "track of each object with events"):
        assert colours(picture(viewer, tmp_path / "view.png", views[name].view_id)) > 20, name
    for name in (best, f"scene: truth, detections, {best}"):
        image = picture(viewer, tmp_path / "view.png", views[name].view_id)
        middle = image[image.shape[0] // 4 : -image.shape[0] // 4, image.shape[1] // 4 : -image.shape[1] // 4]
        assert near(middle, SWITCH) > 100, name  # the ring, in the middle
        assert near(image, TRUTH) > 100, name
        red, green, blue = track_colors(np.array([switch.new_id]))[0].tolist()
        assert near(middle, (red, green, blue), 40) > 20, name
        if run.scene.lanes:
            assert near(image, BORDER) > 100, name


def test_two_agents_are_seen_side_by_side(viewer: ViewerClient, tmp_path: Path) -> None:
    runs = [played("MTP-Intersection-v0", agent) for agent in ("stp", "stp_same_budget")]
    save_recording(tmp_path / "two.rrd", runs, level="all", at=runs[0].incident("ids-0"))
    open_at(viewer, tmp_path / "two.rrd", runs[0].incident("ids-0").frame)
    picture(viewer, tmp_path / "window.png")
    views = {view.name: view for view in viewer.get_state().views}
    assert not any(view.reports for view in views.values())
    for agent in ("stp", "stp_same_budget"):
        image = picture(viewer, tmp_path / "view.png", views[f"{agent}: hypothesis 0"].view_id)
        assert near(image, SWITCH) > 100
        assert near(image, TRUTH) > 100
