"""Scenes to learn from that are scored as well: they are named."""

import pytest

from mtp_bench.cards import load_card, with_split
from mtp_bench.core import MtpBenchError, card_ids, notice
from mtp_bench.running import RunOptions, scenes_of_card
from mtp_bench.sources import open_source
from mtp_bench.training.split import open_split


@pytest.fixture
def spoken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(notice.QUIET_VARIABLE, "0")
    monkeypatch.setattr(notice, "_printed_once", set())


@pytest.mark.data
@pytest.mark.usefixtures("spoken")
def test_scored_scenes_are_named(data_root: str, capsys: pytest.CaptureFixture[str]) -> None:
    options = RunOptions(data_root, split="train")
    open_split("MTP-nuScenes-mini-v0", options)
    said = capsys.readouterr().err
    assert "5 of these 5 scenes are scored by MTP-nuScenes-mini-v0: scene-0655, " in said
    assert "score others with --split train_val (split='train_val')" in said
    open_split("MTP-KITTI-v0", options)
    open_split("MTP-nuScenes-mini-v0", options, away=("scene-0655",))
    assert capsys.readouterr().err == ""


@pytest.mark.data
def test_one_environment_scores_scenes_to_learn_from(data_root: str) -> None:
    """envs/README.md says so."""
    overlapping = set()
    for env_id in card_ids():
        card = load_card(env_id)
        try:
            names = open_source(with_split(card, "train"), data_root).names
        except MtpBenchError:  # not all of the data is there
            continue
        if scenes_of_card(names, card, data_root):
            overlapping.add(env_id)
    assert overlapping == {"MTP-nuScenes-mini-v0"}
