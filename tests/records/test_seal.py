"""Hidden seeds: what was promised is what is run, and nothing published tells it."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

import pytest

from mtp_bench._bundle import bundled
from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.errors import MtpBenchError, RecordError
from mtp_bench.records import load_record, open_seal, seal, submit
from mtp_bench.records.attestation import HiddenPart
from mtp_bench.records.sealing import worse_when_hidden
from mtp_bench.running.options import RunOptions
from mtp_bench.scoring import read_reference
from mtp_bench.sources.highway.source import HighwayTraffic
from tests.support.command_line import CommandLine
from tests.support.stored_records import write_record

ENV = "MTP-Merge-v0"


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Card of two short scenes."""
    text = (bundled("envs") / f"{ENV}.toml").read_text()
    lines = {"seconds": "seconds = 3.0", "vehicles": "vehicles = 8", "val": "val = [10000, 10002]"}
    found = [lines.get(line.split(" = ")[0], line) for line in text.splitlines()]
    path = tmp_path_factory.mktemp("card") / f"{ENV}.toml"
    path.write_text("\n".join(found))
    return str(path)


def test_a_seal_is_a_secret_and_a_promise(tmp_path: Path) -> None:
    promise = seal(ENV, 5, tmp_path / "secret.json")
    secret = json.loads((tmp_path / "secret.json").read_text())
    public = (tmp_path / "secret.commitment.json").read_text()
    assert stat.S_IMODE((tmp_path / "secret.json").stat().st_mode) == 0o600
    assert json.loads(public) == promise.model_dump()
    assert (promise.env, promise.card_digest, promise.count) == (ENV, load_card(ENV).digest, 5)
    assert str(secret["first"]) not in public
    assert secret["salt"] not in public
    assert open_seal(tmp_path / "secret.json").commitment == promise.commitment
    assert seal(ENV, 5, tmp_path / "other.json").commitment != promise.commitment
    with pytest.raises(MtpBenchError, match="a seal is never replaced"):
        seal(ENV, 5, tmp_path / "secret.json")


@pytest.mark.parametrize(
    "change", [{"first": 1_234_567}, {"salt": "0" * 64}, {"count": 4}], ids=lambda x: next(iter(x))
)
def test_another_secret_than_promised_is_refused(change: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "secret.json"
    seal(ENV, 5, path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(RecordError, match=r"has the sha256 .* promises"):
        open_seal(path)


def test_errors_of_seals(cli: CommandLine, tmp_path: Path) -> None:
    out = tmp_path / "s.json"
    assert "MTP-KITTI-v0 is recorded, expected a simulated env" in (
        cli("seal", "--env", "MTP-KITTI-v0", "--count", 2, "-o", out).error
    )
    assert cli("seal", "--env", ENV, "--count", 0, "-o", out).status == 2
    assert "there is no folder" in cli("seal", "--env", ENV, "--count", 2, "-o", tmp_path / "no" / "s.json").error
    assert cli("verify", tmp_path, "--hidden", out).status == 2
    assert cli("verify", tmp_path, "--rerun", "--commitment", out).status == 2
    assert "no such file; `mtp-bench seal`" in cli("verify", tmp_path / "a.json", "--rerun", "--hidden", out).error
    assert not list(tmp_path.iterdir())


def test_hidden_scenes_are_others(short: str, tmp_path: Path) -> None:
    seal(short, 3, tmp_path / "s.json")
    sealed = open_seal(tmp_path / "s.json")
    card = load_card(short)
    hidden = MTPEnv(sealed.card(card))
    first = sealed.seeds.first
    assert hidden.scene_names == tuple(f"merge-{seed}" for seed in range(first, first + 3))
    assert not set(hidden.scene_names) & set(MTPEnv(card).scene_names)


def test_a_submission_on_hidden_scenes(cli: CommandLine, short: str, tmp_path: Path) -> None:
    secret = tmp_path / "s.json"
    said = cli.ok("seal", "--env", short, "--count", 2, "-o", secret)
    assert "publish this commitment to 2 hidden scenes of MTP-Merge-v0, sha256 " in said
    made = submit("stp", short, output=tmp_path / "stp")
    if not made.isolation.holds:
        pytest.skip("this system cannot hide files and network from an agent")
    path = tmp_path / "stp" / f"{ENV}.json"
    said = cli.ok("verify", path, "--env", short, "--rerun", "--hidden", secret, "--jobs", 1, "--write")
    assert "holds, hidden seeds. error " in said
    record = load_record(path)
    assert (record.verification, record.digest) == ("hidden seeds", made.digest)
    assert record.hidden is not None
    assert record.hidden.scenes == 2
    sealed = open_seal(secret)
    assert record.hidden.commitment == sealed.commitment
    weights = tmp_path / "s.weights.json"  # made once per seal
    assert stat.S_IMODE(weights.stat().st_mode) == 0o600
    assert read_reference(weights).digest == record.hidden.weights
    kept = HighwayTraffic(load_card(short)).store
    assert kept.has(10000)
    assert not kept.path(sealed.seeds.first).exists(), "a hidden scene can be read in the cache"
    assert str(open_seal(secret).seeds.first)[:6] not in path.read_text()
    cli.ok("verify", path, "--env", short, "--jobs", 1)  # the times are still those of its own rollouts


def test_a_seal_of_another_card_is_refused(short: str, cli: CommandLine, tmp_path: Path) -> None:
    seal(ENV, 2, tmp_path / "s.json")
    submit("stp", short, RunOptions(scenes=1), tmp_path)
    path = tmp_path / f"{ENV}.json"
    output = cli("verify", path, "--env", short, "--rerun", "--hidden", tmp_path / "s.json", "--jobs", 1)
    assert output.error.startswith(f"the seal is of {ENV} with card digest")


@pytest.mark.parametrize(("low", "worse"), [(1.9, False), (2.1, True), (None, False)])
def test_an_agent_that_knows_the_public_scenes_is_worse_on_hidden_ones(low: float | None, worse: bool) -> None:
    record = write_record(1.0, 2.0, interval=[1.0, 2.0])
    interval = None if low is None else (low, 3.0)
    hidden = HiddenPart(commitment="aa", weights="bb", scenes=9, targets=90, error=2.5, interval=interval)
    assert worse_when_hidden(record, hidden) is worse
