"""The scenes that are learnt from: none of them is of the fold that is left out."""

from __future__ import annotations

import pytest

from mtp_bench.errors import MtpBenchError
from mtp_bench.running.options import Fold, RunOptions, held_out
from mtp_bench.training.predictors import TrainingRequest, training_windows
from mtp_bench.training.split import open_split
from tests.support.command_line import write_training

NAMES = ("0000", "0002", "0003", "0004", "0005", "0007", "0009", "0010")
FOLDS = [(1, 4), (4, 4)]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data root whose training split has eight scenes."""
    return write_training(tmp_path_factory.mktemp("folds"), "0001", NAMES)


@pytest.mark.parametrize("fold", FOLDS)
def test_a_fold_is_left_out_before_scenes_are_counted(root: str, card: str, fold: Fold) -> None:
    rest = tuple(name for name in NAMES if name not in held_out(NAMES, fold))
    assert open_split(card, RunOptions(root, split="train"), fold).names == rest
    assert open_split(card, RunOptions(root, split="train", scenes=3), fold).names == rest[:3]


@pytest.mark.parametrize("fold", FOLDS)
def test_a_predictor_learns_from_no_scene_that_its_fold_scores(root: str, card: str, fold: Fold) -> None:
    """The first scenes are not cut into folds of their own: that would be another lot than the one that is scored."""
    scored = RunOptions(root, scenes=5, fold=fold).chosen(NAMES)
    learnt = training_windows(TrainingRequest("modes", card, fold=fold), RunOptions(root, scenes=5)).names
    assert not set(learnt) & set(scored)
    assert len(learnt) == 5


def test_too_few_scenes_for_a_fold(root: str, card: str) -> None:
    with pytest.raises(MtpBenchError, match="8 scenes cannot be cut into 9 folds"):
        open_split(card, RunOptions(root, split="train"), (1, 9))
