"""Blocks of recordings."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.scoring.targets import units
from mtp_bench.sources import open_source
from tests.support.scoring_scenes import make_card, make_scene
from tests.support.source_files import with_task

CARD = make_card()
BLOCKS = {
    # frames, rate: frames of each block
    "nothing": (0, 2.0, []),
    "one frame": (1, 2.0, [1]),
    "WILDTRACK": (40, 2.0, [40]),
    "nuScenes": (41, 2.0, [41]),
    "a second more than a block is one": (42, 2.0, [42]),
    "21.5 s": (43, 2.0, [22, 21]),
    "20 s": (200, 10.0, [200]),
    "40 s": (400, 10.0, [200, 200]),
    "60 s": (601, 10.0, [201, 200, 200]),
}


@pytest.mark.parametrize(("frames", "rate", "want"), BLOCKS.values(), ids=BLOCKS.keys())
def test_blocks_are_few_equal_and_at_most_20_s(frames: int, rate: float, want: list[int]) -> None:
    scene = replace(make_scene([[]] * frames), time=np.arange(frames) / rate)
    block = units(scene, with_task(CARD, rate=rate))
    assert np.bincount(block, minlength=len(want)).tolist() == want
    assert (np.diff(block) >= 0).all()


@pytest.mark.parametrize(("frames", "blocks"), [(41, 1), (44, 2)])
def test_a_hole_counts_as_one_period(frames: int, blocks: int) -> None:
    time = np.cumsum(0.5 + 0.1 * np.sin(np.arange(frames))) + 30.0 * (np.arange(frames) > 20)  # it jitters too
    block = units(replace(make_scene([[]] * frames), time=time), with_task(CARD, rate=2.0))
    assert block.max() + 1 == blocks


# scenes, units
RECORDED = {
    "MTP-nuScenes-mini-v0": (10, 10),
    "MTP-WILDTRACK-v0": (4, 4),
    "MTP-PETS-v0": (4, 4),
    "MTP-KITTI-v0": (11, 25),
    "MTP-KITTI-5Hz-v0": (11, 25),
}


@pytest.mark.data
@pytest.mark.parametrize(("env", "want"), RECORDED.items(), ids=RECORDED.keys())
def test_units_of_recorded_scenes(data_root: object, env: str, want: tuple[int, int]) -> None:
    source = open_source(card := load_card(env))
    blocks = [int(units(source.load(name), card).max()) + 1 for name in source.names]
    assert (len(blocks), sum(blocks)) == want
