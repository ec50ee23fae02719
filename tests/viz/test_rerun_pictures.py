"""A picture of an identity switch, made by the viewer without a screen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench import load_submission
from mtp_bench.env import MTPEnv
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.viz.palette import Color
from mtp_bench.viz.replay import Replay, replay
from mtp_bench.viz.rerun.colors import BORDER, SWITCH, track_colors
from mtp_bench.viz.rerun.focus import COLORS
from mtp_bench.viz.rerun.recording import save_recording
from mtp_bench.viz.rerun.sdk import ViewerClient
from tests.support.headless_viewer import headless_viewer, near, picture, require_driver, until


@pytest.fixture(scope="module")
def viewer() -> Iterator[ViewerClient]:
    require_driver()
    with headless_viewer() as client:
        yield client


def played(env_id: str, agent: str) -> Replay:
    """A baseline on the first scene."""
    env = MTPEnv(env_id, evaluation=True)
    rollout = run_scene(load_submission(agent).build(agent_task(env, 0)), env, env.scene_names[0], seed=0)
    return replay(env.scene, rollout, env.card, agent)


def track_color(track_id: int) -> Color:
    """The colour that a track has among all."""
    red, green, blue = track_colors(np.array([track_id]))[0].tolist()
    return red, green, blue


def colours(image: NDArray[np.uint8]) -> int:
    """Number of different colours."""
    return len(np.unique(image.reshape(-1, 3), axis=0))


def test_an_identity_switch_is_seen(viewer: ViewerClient, tmp_path: Path) -> None:
    run = played("MTP-Intersection-v0", "stp")
    switch = run.incident("ids-0")
    save_recording(tmp_path / "switch.rrd", [run], at=switch)
    viewer.close("all")
    (store,) = viewer.open(str(tmp_path / "switch.rrd")).store_ids

    def at_the_switch() -> None:
        viewer.take_screenshot()
        times = {one.store_id: one.current_time for one in viewer.get_state().recordings}
        if times.get(store) != switch.frame:
            raise RuntimeError(f"{times}, expected {switch.frame}")

    until(at_the_switch)  # the file comes to stand there by itself
    sleep(1.0)
    at_the_switch()
    assert colours(picture(viewer, tmp_path / "window.png")) > 400  # and now every visible view has been drawn
    views = {view.name: view for view in viewer.get_state().views}
    assert not any(view.reports for view in views.values())
    others = ("boxes per frame", "events so far", "track of each object with events", "what happened")
    for name in (*others, "the frames t - 1, t and t + 1"):
        assert colours(picture(viewer, tmp_path / "view.png", views[name].view_id)) > 20, name
    image = picture(viewer, tmp_path / "view.png", views["ids-0 alone"].view_id)
    middle = image[image.shape[0] // 4 : -image.shape[0] // 4, image.shape[1] // 4 : -image.shape[1] // 4]
    assert near(middle, SWITCH) > 100  # the ring, in the middle
    for role in ("truth", "before", "now"):
        assert near(image, COLORS[role], 40) > 20, role
    assert near(image, track_color(switch.new_id)) < 20, "the colours of tracks are dim"
    assert near(image, BORDER) > 20  # of the road
