"""The Python blocks of the pages on own trackers and stored tracks."""

import re
from pathlib import Path
from typing import Any

from mtp_bench import MTPEnv
from mtp_bench.running import stored
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.stored import open_run
from mtp_bench.running.track_export import export_tracks


def names_of(page: Path) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "page"}
    blocks = re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, str(page), "exec"), names)
    return names


def test_the_tracker_of_the_page_tracks(repository: Path, card: str, kitti: str) -> None:
    build = names_of(repository / "docs/agents/own_tracker.md")["build"]
    env = MTPEnv(card, kitti)
    rollout = run_scene(build(agent_task(env, 0)), env, "0001", 0)
    assert rollout.invalid.sum() == 0
    assert set(rollout.tracks.counts.tolist()) == {0, 3}  # nothing is detected in frames 3 and 4
    assert set(rollout.track_id[:9].tolist()) == {0, 1, 2}


def test_stored_tracks_are_shown(repository: Path, card: str, kitti: str, tmp_path: Path) -> None:
    stored.run("stp", card, tmp_path / "run", RunOptions(kitti))
    export_tracks(open_run(tmp_path / "run", kitti), tmp_path / "tracks")
    first_ids = names_of(repository / "docs/data/stored_tracks.md")["first_ids"]
    assert sorted(first_ids(card, kitti, str(tmp_path / "tracks"))) == [0, 1, 2]
