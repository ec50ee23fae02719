"""The training of networks: it learns, and it repeats itself."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from mtp_bench.cards import Card, load_card
from mtp_bench.core import Bools
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.prediction.learned.network import network_of
from mtp_bench.prediction.learned.predictor import find_weights, read_weights, require_fit
from mtp_bench.running.options import Fold, RunOptions, fold_of, held_out
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.training.fitting import TrainingPlan
from mtp_bench.training.losses import Tensors, mode_distance, vary_tracks
from mtp_bench.training.predictors import (
    TrainingRequest,
    _require_same_task,
    has_future,
    train_predictor,
    training_windows,
    validation_rows,
)
from mtp_bench.training.split import open_split
from mtp_bench.training.tracklets import Windows, concatenate, windows_of_scene
from tests.support.command_line import CommandLine, write_training
from tests.support.small_scenes import make_scene, task, write_card, write_kitti

QUICK = TrainingPlan(epochs=6, batch=32)


@pytest.fixture
def found(tmp_path: Path) -> Windows:
    return windows_of_scenes(tmp_path, "abcdefg", frames=12)


def windows_of_scenes(folder: Path, names: str, frames: int) -> Windows:
    """The windows that are learnt from, of a scene for each letter of ``names``."""
    card = load_card(write_card(folder))
    scenes = [make_scene(name, frames=frames) for name in names]
    whole = concatenate([windows_of_scene(scene, card, task(), HypothesisTracker()) for scene in scenes])
    return whole.select(has_future(whole))


def test_training_lowers_the_error_and_repeats_itself(found: Windows, tmp_path: Path) -> None:
    curve: list[float] = []
    request = TrainingRequest("modes", "small", "tracklets", plan=replace(QUICK, epochs=25))
    path, card = train_predictor(found, request, tmp_path / "one.safetensors", lambda _, error: curve.append(error))
    assert min(curve[10:]) < 0.5 * curve[0]
    assert card["validation_minADE"] == round(min(curve), 4)
    assert card["present"]
    assert card["scenes"] == list("abcdefg")
    again, _ = train_predictor(found, request, tmp_path / "two.safetensors")
    assert path.read_bytes() == again.read_bytes()
    assert [file.suffix for file in tmp_path.iterdir() if "one" in file.name] == [".safetensors"]
    require_fit(read_weights(path, network_of("modes")).sizes, found.task, path)


def test_it_stops_where_nothing_gets_better(found: Windows, tmp_path: Path) -> None:
    request = TrainingRequest("modes", "small", plan=replace(QUICK, epochs=60, patience=1, rate=1e-9))
    epochs: list[int] = []
    train_predictor(found, request, tmp_path / "a.safetensors", lambda epoch, _: epochs.append(epoch))
    assert 30 <= len(epochs) < 60


def test_validation_is_of_whole_scenes_where_there_are_enough(found: Windows) -> None:
    rows = validation_rows(found)
    assert len(set(found.scene[rows].tolist())) == 1
    assert not set(found.scene[rows].tolist()) & set(found.scene[~rows].tolist())
    few = found.select(found.scene < 2)
    rows = validation_rows(few)
    for scene in (0, 1):
        mine = few.scene == scene
        assert few.frame[mine & rows].min() > few.frame[mine & ~rows].max()


@pytest.mark.parametrize("names", ["abcdefg", "abc"])
def test_no_scene_is_learnt_from_whose_twin_of_another_env_is_validated_on(names: str, tmp_path: Path) -> None:
    """Two envs may show the same traffic, each with its own detector."""
    one = windows_of_scenes(tmp_path, names, frames=12)
    both = concatenate([one, replace(one, task=task(env_id="MTP-SmallRaw-v0"), envs=("MTP-SmallRaw-v0",))])
    rows = validation_rows(both)
    validated, learnt = shown_in(both, rows), shown_in(both, ~rows)
    assert validated
    assert not validated & learnt
    for env in (0, 1):
        assert shown_in(both, rows & (both.scene // len(names) == env)) == validated


def shown_in(found: Windows, rows: Bools) -> set[tuple[str, int]]:
    """What these windows show: scenes by their own names, and frames."""
    return {(found.own_names[found.scene[row]], int(found.frame[row])) for row in np.flatnonzero(rows)}


@pytest.mark.parametrize(
    ("names", "frames", "learnt"), [("abc", 3, 18), ("abc", 5, 18), ("abcdef", 3, 30)],
    ids=["without whole futures", "without a last fifth", "many scenes"],
)  # fmt: skip
def test_scenes_too_short_to_validate_on(names: str, frames: int, learnt: int, tmp_path: Path) -> None:
    request, out = TrainingRequest("modes", "small", plan=QUICK), tmp_path / "new" / "w.safetensors"
    with pytest.raises(MtpBenchError, match=f"scenes {len(names)}, windows to learn from {learnt}, .* validate on 0"):
        train_predictor(windows_of_scenes(tmp_path, names, frames), request, out)
    assert not out.parent.exists()


def test_a_varied_batch_is_the_same_motion_seen_otherwise() -> None:
    rng = np.random.default_rng(0)
    n, past = 64, 5
    position = torch.from_numpy(rng.normal(size=(n, past, 2)).astype(np.float32))
    batch: Tensors = {
        "position": position, "velocity": position.clone(), "yaw": torch.zeros(n, past),
        "alive": torch.ones(n, past), "taken": torch.ones(n, past), "counts": torch.full((n, 2), 3.0),
        "future": position[:, :3] + 1, "present": position[:, 0],
    }  # fmt: skip
    out = vary_tracks(batch, torch.Generator().manual_seed(0))
    length = torch.linalg.norm(batch["future"], dim=-1)
    np.testing.assert_allclose(torch.linalg.norm(out["future"], dim=-1), length, rtol=1e-5)
    np.testing.assert_allclose(out["velocity"], out["position"])
    cut = out["alive"].sum(dim=1) < past
    assert 0 < cut.sum() < n / 2
    assert (out["alive"][:, -1] == 1).all()
    np.testing.assert_allclose(out["counts"][~cut], 3.0)
    np.testing.assert_allclose(out["counts"][cut, 0].exp(), out["alive"][cut].sum(dim=1), rtol=1e-5)
    turned = torch.linalg.det(torch.stack([out["future"][:, 0], out["future"][:, 1]], dim=-1))
    plain = torch.linalg.det(torch.stack([batch["future"][:, 0], batch["future"][:, 1]], dim=-1))
    assert n / 4 < (turned * plain < 0).sum() < 3 * n / 4


def test_the_distance_of_a_mode_counts_known_frames_alone() -> None:
    modes = torch.tensor([[[[3.0, 4.0], [0.0, 1.0]], [[0.0, 0.0], [100.0, 0.0]]]])
    future, known = torch.zeros(1, 2, 2), torch.tensor([[1.0, 0.0]])
    np.testing.assert_allclose(mode_distance(modes, future, known), [[5.0, 0.0]], atol=1e-4)


def test_folds() -> None:
    names = [f"s{number}" for number in range(10)]
    parts = [held_out(names, (number, 3)) for number in (1, 2, 3)]
    assert (sorted(name for part in parts for name in part), held_out(names[::-1], (1, 3))[::-1]) == (names, parts[0])
    assert fold_of("2/3") == (2, 3)
    for wrong in ("0/3", "4/3", "1", "1/1", "a/b", "\u0661/\u0664"):
        with pytest.raises(MtpBenchError, match=r"such as 1/4"):
            fold_of(wrong)


def test_the_command(tmp_path: Path, cli: CommandLine) -> None:
    root, card = write_kitti(tmp_path), write_card(tmp_path)
    out = tmp_path / "w.safetensors"
    options = ["--env", card, "--data", root, "--split", "val", "--epochs", "2", "--jobs", "1", "-o", str(out)]
    done = cli("train", "predictor", "modes", *options)
    assert done.status == 0, done.err
    assert "validation minADE" in done.out
    assert out.is_file()
    refused = cli("train", "predictor", "mods", *options)
    assert refused.status == 2
    assert "expected one of" in refused.err
    assert cli("train", "predictor", "modes", "--on", "detections", *options).status == 2
    assert cli("train", "predictor", "modes", "--fold", "5/4", *options).status == 2


@pytest.mark.parametrize(
    ("name", "value"),
    [("past", 7), ("future", 9), ("dt", 0.3), ("k", 9), ("ego_motion", False), ("classes", ("van", "car"))],
)
def test_envs_that_are_not_alike(name: str, value: object) -> None:
    _require_same_task(task(), task())
    _require_same_task(task(), task(classes=("car",)))  # an env may teach some of the classes
    with pytest.raises(MtpBenchError, match="one network cannot be trained on both"):
        _require_same_task(task(), task(**{name: value}))


def test_no_env_teaches_what_a_fold_holds_out(found: Windows, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The envs have some scenes in common, and draw their own folds by other lots."""
    some, more = write_card(tmp_path), tmp_path / "MTP-More-v0.toml"
    more.write_text(Path(some).read_text().replace("MTP-Small-v0", "MTP-More-v0"))
    scenes = {"MTP-Small-v0": tuple("abcdef"), "MTP-More-v0": tuple("abcdefghijklm")}
    learnt: dict[str, Sequence[str]] = {}

    def opened(card: Card, _: object) -> SimpleNamespace:
        return SimpleNamespace(names=scenes[card.id])

    def watched(env_id: str, _split: str, _tracker: object, names: Sequence[str], _options: RunOptions) -> Windows:
        learnt[env_id] = names
        return found

    monkeypatch.setattr("mtp_bench.training.split.open_source", opened)
    monkeypatch.setattr("mtp_bench.training.predictors.windows", watched)
    for number in (1, 2, 3):
        away = set(held_out(scenes["MTP-Small-v0"], (number, 3)))
        training_windows(TrainingRequest("modes", some, fold=(number, 3), also=(str(more),)))
        assert len(learnt) == 2
        assert not any(away & set(names) for names in learnt.values())


def test_weights_lie_where_agents_look(found: Windows, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A card may be given as a path; agents know the id of its env."""
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path / "weights"))
    path, card = train_predictor(
        found, TrainingRequest("modes", str(tmp_path / "MTP-Small-v0.toml"), plan=replace(QUICK, epochs=1))
    )
    assert (path, card["env"]) == (tmp_path / "weights" / "modes-truth-MTP-Small-v0.safetensors", "MTP-Small-v0")
    assert find_weights("modes", "truth", found.task) == path


NAMES = ("0000", "0002", "0003", "0004", "0005", "0007", "0009", "0010")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data root whose training split has eight scenes."""
    return write_training(tmp_path_factory.mktemp("folds"), "0001", NAMES)


@pytest.mark.parametrize("fold", [(1, 4), (4, 4)])
def test_a_predictor_learns_from_no_scene_that_its_fold_scores(root: str, card: str, fold: Fold) -> None:
    """The first scenes are not cut into folds of their own: that would be another lot than the one that is scored."""
    rest = tuple(name for name in NAMES if name not in held_out(NAMES, fold))
    for scenes in (None, 3):
        assert open_split(card, RunOptions(root, split="train", scenes=scenes), fold).names == rest[:scenes]
    options = RunOptions(root, scenes=5)
    learnt = training_windows(TrainingRequest("modes", card, fold=fold), options).names
    assert not set(learnt) & set(replace(options, fold=fold).chosen(NAMES))
    assert len(learnt) == 5
