"""``mtp-bench train``: which scenes it learns from, and what it says where they are too short."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.commands.output import fail
from mtp_bench.core import Scene
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.running.options import RunOptions, held_out
from mtp_bench.training import motion_noise
from mtp_bench.training.predictors import TrainingRequest
from tests.support.command_line import CommandLine, read_json, write_submission, write_training

pytestmark = pytest.mark.usefixtures("remembered_weights")
NAMES = ("0002", "0003", "0004", "0005")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data root whose training split has four scenes."""
    return write_training(tmp_path_factory.mktemp("train"), "0006", NAMES)


def test_noise_without_a_fold(cli: CommandLine, root: str, card: str, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def watched(scenes: Sequence[Scene], *_: object) -> dict[str, Any]:
        read.extend(scene.name for scene in scenes)
        return {"car": {}}

    monkeypatch.setattr(motion_noise, "fit_scenes", watched)
    known = ("train", "motion-noise", "--env", card, "--data", root)
    cli.ok(*known, "--fold", "1/2")
    assert read == [name for name in NAMES if name not in held_out(NAMES, (1, 2))]
    read.clear()
    cli.ok(*known)
    assert read == list(NAMES)


@pytest.mark.parametrize(
    "scenes", [("--split", "val"), ("--files", "logs"), ("--detector", "iid"), ("--detections", "logs")]
)
def test_weights_of_other_scenes_have_a_file_of_their_own(
    scenes: tuple[str, str], cli: CommandLine, root: str, card: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else every run of the env would take them."""
    monkeypatch.setattr("mtp_bench.training.training_windows", None)
    error = cli("train", "predictor", "modes", "--env", card, "--data", root, *scenes).error
    assert re.match(r"--(split val|files|detector|detections): without -o the weights", error)


@pytest.fixture
def learnt(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int | None]]:
    """What each training would learn from: the pasts, and the number of scenes."""
    requests: list[tuple[str, int | None]] = []

    def learnable(request: TrainingRequest, options: RunOptions) -> None:
        requests.append((request.on, options.scenes))
        raise MtpBenchError("enough")

    monkeypatch.setattr("mtp_bench.training.training_windows", learnable)
    monkeypatch.setattr("mtp_bench.commands.train.prepare", lambda *_: None)  # it would simulate the scenes
    return requests


LEARNT = [
    ("modes", "", (), ("truth", None)), ("affinity", "", (), ("tracklets", None)),
    ("tracking_free", "", (), ("tracklets", None)), ("modes", "MTP-Intersection-v0", (), ("truth", 60)),
    ("modes", "MTP-Drive-Intersection-10Hz-v0", (), ("truth", 8)),
    ("modes", "MTP-Drive-Intersection-10Hz-v0", ("--scenes", "3"), ("truth", 3)),
]  # fmt: skip


@pytest.mark.parametrize(("network", "env", "given", "expected"), LEARNT)
def test_pasts_and_numbers_of_scenes_that_are_learnt_from(
    network: str, env: str, given: Sequence[str], expected: Any, cli: CommandLine, root: str, card: str, learnt: Any
) -> None:
    """Of simulated traffic 2400 frames, of recorded data everything."""
    known = ("train", "predictor", network, "--env", env or card, "--data", root, *given)
    assert (cli(*known).error, learnt) == ("enough", [expected])
    assert "unknown environment" in cli(*known, "--also", "MTP-Merg-v0").error
    assert len(learnt) == 1


def test_a_failing_and_a_weightless_agent_cost_the_good_one_nothing(
    cli: CommandLine, known: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path / "empty"))
    mine = write_submission(tmp_path / "mine", "mine")
    bad = write_submission(tmp_path / "bad", "bad", body="raise ValueError(observation)")
    alone, beside = tmp_path / "alone.json", tmp_path / "beside.json"
    cli.ok("compare", mine, *known, "--seeds", 1, "--json", alone)
    output = cli("compare", bad, mine, "affinity", *known, "--seeds", 1, "--json", beside)
    assert (output.status, output.err) == (1, "")
    rows, expected = read_json(beside)["rows"], read_json(alone)["rows"]
    assert rows == expected
    failures = read_json(beside)["failures"]
    assert list(failures) == ["affinity", "bad"]
    assert "predictor affinity --env MTP-Small-v0 --on tracklets (about 5 min on two cores)" in failures["affinity"]


def test_missing_networks_are_trained_first_the_quickest_one_first(
    cli: CommandLine, known: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path))
    (tmp_path / "modes-truth-MTP-Small-v0.safetensors").touch()
    asked: list[tuple[str, str]] = []

    def trained(split: str, request: TrainingRequest, *_: object) -> tuple[str, dict[str, Any]]:
        asked.append((request.network, request.on))
        return split, {}

    monkeypatch.setattr("mtp_bench.training.training_windows", lambda request, options: options.split)
    monkeypatch.setattr("mtp_bench.training.train_predictor", trained)
    monkeypatch.setattr("mtp_bench.commands.compare.run_comparison", lambda *_, **__: fail("trained"))
    output = cli("compare", "stp_ptp", "affinity", "mtp_modes", *known, "--train")
    assert "training affinity-tracklets, ptp-truth first: about 59 min on two cores" in output.err
    assert asked == [("affinity", "tracklets"), ("ptp", "truth")]
