"""The road in pictures of nuScenes, through the commands: there with the map expansion, else left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mtp_bench.running.stored import open_run
from mtp_bench.viz.drawing.birds_eye import ROAD
from mtp_bench.viz.replay import replay
from tests.support.command_line import CommandLine
from tests.support.map_expansion import make_map, write_map
from tests.support.nuscenes_root import link_root

ENV, SCENE = "MTP-nuScenes-mini-v0", "scene-0061"

pytestmark = pytest.mark.data


def road(path: Path) -> int:
    """Number of pixels that show road."""
    with Image.open(path) as image:
        pixels: NDArray[np.int64] = np.asarray(image.convert("RGB")).astype(np.int64)
    return int((np.abs(pixels - np.array(ROAD)).max(axis=-1) <= 2).sum())


def test_the_road_lies_under_an_event(cli: CommandLine, data_root: Path, tmp_path: Path) -> None:
    data, run = link_root(tmp_path / "root", data_root), tmp_path / "run"
    cli.ok("run", "stp", "--env", ENV, "--scenes", "1", "--data", data, "-o", run)
    event = ("view", run, "--data", data, "--scene", SCENE, "--at", "lost-0", "--png")
    cli.ok(*event, tmp_path / "plain.png")
    stored = open_run(run, str(data))
    x, y, _ = replay(stored.scene(SCENE), stored.first(SCENE), stored.card).incident("lost-0").position
    path = write_map(data / "nuscenes", "singapore-onenorth", make_map((x, y, 0.0)))
    cli.ok(*event, tmp_path / "road.png")
    assert road(tmp_path / "road.png") > 1000 + road(tmp_path / "plain.png")
    path.write_text("{", encoding="utf-8")
    output = cli(*event, tmp_path / "broken.png")
    assert output.status == 0
    assert " ".join(output.err.split()).startswith(f"drawn without the road: {path}")
    assert (tmp_path / "broken.png").read_bytes() == (tmp_path / "plain.png").read_bytes()
