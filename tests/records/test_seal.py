"""Hidden seeds: what was promised is what is run, and nothing published tells it."""

import json
import shutil
import stat
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench import MTPEnv
from mtp_bench.cards import load_card
from mtp_bench.core.errors import MtpBenchError, RecordError
from mtp_bench.judge import open_seal, read_level, retire, seal, submit, trusted, verify, why_unranked
from mtp_bench.judge.records.canonical import today
from mtp_bench.judge.records.record import HiddenPart
from mtp_bench.judge.records.rerun import run_again
from mtp_bench.judge.records.running import Runs
from mtp_bench.judge.records.seal import Sealed, open_seals
from mtp_bench.running.options import RunOptions
from mtp_bench.scoring import read_reference
from mtp_bench.traffic.highway.source import HighwayTraffic
from tests.support.command_line import CommandLine, read_json
from tests.support.small_scenes import write_short_card
from tests.support.stored_records import as_if_shipped, ships_of

ENV = "MTP-Merge-v0"
pytestmark = pytest.mark.usefixtures("few_event_runs")
SCENES = 4  # enough for intervals
TOO_FEW = f"scored on {SCENES} hidden scenes, ranks need 50"


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_short_card(tmp_path_factory.mktemp("card"), ENV)


def test_a_seal_is_a_secret_and_a_promise(tmp_path: Path) -> None:
    promise = seal(ENV, 5, tmp_path / "secret.json")
    secret = json.loads((tmp_path / "secret.json").read_text())
    public = (tmp_path / "secret.commitment.json").read_text()
    assert stat.S_IMODE((tmp_path / "secret.json").stat().st_mode) == 0o600
    assert json.loads(public) == promise.model_dump()
    assert (promise.env, promise.card_digest, promise.count) == (ENV, load_card(ENV).digest, 5)
    assert not any(each in public for each in (str(secret["first"]), secret["salt"]))
    assert open_seal(tmp_path / "secret.json").commitment == promise.commitment
    assert seal(ENV, 5, tmp_path / "other.json").commitment != promise.commitment
    with pytest.raises(MtpBenchError, match="a seal is never replaced"):
        seal(ENV, 5, tmp_path / "secret.json")


@pytest.mark.parametrize("change", [{"first": 2**41}, {"salt": "0" * 64}, {"count": 4}], ids=lambda x: next(iter(x)))
def test_another_secret_than_promised_is_refused(change: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "secret.json"
    seal(ENV, 5, path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(RecordError, match=r"has the sha256 .*, expected .* as in"):
        open_seal(path)


def test_no_public_number_tells_a_hidden_scene(tmp_path: Path) -> None:
    """The motion of a scene follows from a seed and its name; of a public seed it would tell the name to who tries."""
    seal(ENV, 50, tmp_path / "s.json")
    seal(ENV, 50, tmp_path / "t.json")
    one, other = open_seal(tmp_path / "s.json"), open_seal(tmp_path / "t.json")
    assert one.seeds.first >= 2**40
    assert one.run_seed(0) > 2**40
    assert len({one.run_seed(0), one.run_seed(1), other.run_seed(0)}) == 3
    assert one.run_seed(0) == open_seal(tmp_path / "s.json").run_seed(0), "anyone can repeat a retired round"
    names = [f"merge-{i}" for i in range(50)]
    order = one.shuffled(names)
    assert sorted(order) == sorted(names)
    assert list(order) != names
    assert order != other.shuffled(names)
    assert order == one.shuffled(reversed(names)), "the same for every submission"


def test_hidden_scenes_are_others(short: str, tmp_path: Path) -> None:
    seal(short, 3, tmp_path / "s.json")
    sealed = open_seal(tmp_path / "s.json")
    card = load_card(short)
    hidden = MTPEnv(sealed.card(card))
    first = sealed.seeds.first
    assert hidden.scene_names == tuple(f"merge-{seed}" for seed in range(first, first + 3))
    assert not set(hidden.scene_names) & set(MTPEnv(card).scene_names)


@pytest.mark.needs("sandbox")
def test_a_run_on_hidden_scenes(cli: CommandLine, short: str, tmp_path: Path, leaderboard: Path, key: Path) -> None:
    """From the seal to a signed level; the signer's key and the commitment are in the leaderboard."""
    secret = tmp_path / "s.json"
    said = cli.ok("maintain", "seal", "--env", short, "--count", SCENES, "-o", secret)
    assert f"publish this commitment to {SCENES} hidden scenes of MTP-Merge-v0 in leaderboard/seals, sha256 " in said
    assert f"for trials alone: {SCENES} scenes are too few to rank, ranks need 50" in said
    shutil.copy(tmp_path / "s.commitment.json", leaderboard / "seals")
    made = submit("stp", short, RunOptions(seeds=(0,)), tmp_path / "stp")
    path = tmp_path / "stp" / f"{ENV}.json"
    before = read_json(path)
    arguments = ("verify", path, "--env", short, "--rerun", "--hidden", secret, "--jobs", 1, "--base", leaderboard)
    said = cli.ok(*arguments, "--sign", key, "--signer", "tester")
    assert "holds, hidden. error " in said
    assert read_json(path) == before | {"level": read_json(path)["level"]}, "it never changes the record"
    trust, sealed = trusted(leaderboard), open_seal(secret)
    signed, why = read_level(path, made, trust)
    assert signed is not None, why
    stated, hidden = signed.statement, signed.statement.hidden
    assert (stated.level, signed.signer, stated.isolation) == ("hidden", "tester", made.isolation.mechanism)
    assert hidden is not None
    assert (hidden.commitment, hidden.scenes) == (sealed.commitment, SCENES)
    assert hidden.row.interval is not None, "what is checked of it is checked here too"
    assert hidden.row.error == pytest.approx(sum(hidden.unit_error("all")) / sum(hidden.unit_weight("all")))
    frozen = made.reference.model_copy(update={"frozen": True})  # the card of this test has none
    ranks = made.model_copy(update={"reference": frozen, "seeds": [0, 1, 2]})
    with as_if_shipped(ships_of(made, simulated=True)):
        assert why_unranked(ranks, hidden) == TOO_FEW
    weights = tmp_path / "s.weights.json"  # made once per seal
    assert (stat.S_IMODE(weights.stat().st_mode), read_reference(weights).digest) == (0o600, hidden.weights)
    kept = HighwayTraffic(load_card(short)).store
    assert kept.read(10000) is not None
    assert not kept.path(sealed.seeds.first).exists(), "a hidden scene can be read in the cache"
    assert str(sealed.seeds.first) not in path.read_text()
    two = cli(*arguments, tmp_path / "none.json", "--sign", key, "--signer", "tester")
    assert f"hidden since {signed.statement.date}, signed by tester" in two.out
    assert "no such record" in two.error
    assert f" hidden error {hidden.row.error:.3f} m " in two.out, "the table of several records says it too"
    cli.ok("verify", path, "--env", short, "--jobs", 1)  # the times are still those of its own rollouts
    scenes_stay_until_a_round_ends(path, short, sealed, hidden)
    said = cli.ok("maintain", "seal", "--retire", secret, "-o", leaderboard / "seals")
    assert "the secret is public from now on" in said
    signed, _ = read_level(path, made, trusted(leaderboard))
    assert signed is not None
    assert signed.seal is not None
    assert signed.seal.retired
    published = json.loads((leaderboard / "seals" / "s.retired.json").read_text())
    assert (published["secret"]["first"], published["weights"]) == (sealed.seeds.first, hidden.weights)
    assert read_reference(leaderboard / "seals" / "s.weights.json").digest == hidden.weights
    assert "this seal is retired" in cli(*arguments).error


def test_no_run_for_a_level_that_is_not_shown(cli: CommandLine, tmp_path: Path, leaderboard: Path, key: Path) -> None:
    secret = tmp_path / "s.json"
    cli.ok("maintain", "seal", "--env", ENV, "--count", SCENES, "-o", secret)
    arguments = ("verify", tmp_path / "a.json", "--rerun", "--hidden", secret, "--base", leaderboard)
    signing = ("--sign", key, "--signer", "tester")
    assert f"the seal of {ENV} with the sha256 " in (said := cli(*arguments, *signing).error)
    assert "publish its commitment there first" in said
    shutil.copy(tmp_path / "s.commitment.json", leaderboard / "seals")
    assert "no such record" in cli(*arguments, *signing).error


def scenes_stay_until_a_round_ends(path: Path, short: str, sealed: Sealed, hidden: HiddenPart) -> None:
    """The next record of a round finds the scenes of the one before it; a scene that hangs there shows nothing."""
    scene = HighwayTraffic(load_card(short)).store.path(sealed.seeds.first)
    with ExitStack() as ends, pytest.MonkeyPatch.context() as patch:
        checked = verify(path, RunOptions(), short, rerun=True, sealed=sealed, ends=ends)
        assert scene.exists()
        assert (checked.level, checked.differences, checked.hidden) == ("hidden", (), hidden)
        patch.setattr("mtp_bench.judge.records.rerun.run_again", lambda *given: _hung(run_again(*given)))
        with pytest.raises(RecordError, match="stp: 1 runs of hidden scenes were not finished"):
            verify(path, RunOptions(), short, rerun=True, sealed=sealed, ends=ends)
    assert not scene.exists()


def _hung(runs: Runs) -> Runs:
    return {seed: [replace(first, status="hung"), *others] for seed, (first, *others) in runs.items()}


def test_what_was_published_must_be_what_was_promised(leaderboard: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        seal(ENV, 2, tmp_path / f"{name}.json")
        retire(tmp_path / f"{name}.json", leaderboard / "seals")
    assert {listed.retired for listed in trusted(leaderboard).listed.values()} == {today()}
    shutil.copy(leaderboard / "seals" / "b.retired.json", leaderboard / "seals" / "a.retired.json")
    with pytest.raises(RecordError, match=r"a\.retired\.json: its secret does not have the commitment"):
        _ = trusted(leaderboard).listed


def test_a_folder_of_seals_is_opened_by_env(leaderboard: Path, tmp_path: Path) -> None:
    trust = trusted(leaderboard)
    with pytest.raises(RecordError, match="no secret of a seal in use"):
        open_seals(tmp_path, trust.listed)
    for env in (ENV, "MTP-Highway-v0"):
        seal(env, 2, tmp_path / f"{env}.json")
    assert sorted(open_seals(tmp_path, trust.listed)) == ["MTP-Highway-v0", ENV]
    seal(ENV, 2, tmp_path / "again.json")
    with pytest.raises(RecordError, match="a second seal of MTP-Merge-v0"):
        open_seals(tmp_path, trust.listed)
    retire(tmp_path / "again.json", leaderboard / "seals")  # as a maintainer does: the secret stays where it was
    found = open_seals(tmp_path, trusted(leaderboard).listed)
    assert found[ENV].commitment == open_seal(tmp_path / f"{ENV}.json").commitment


@pytest.mark.needs("sandbox")
def test_a_seal_of_another_card_is_refused(short: str, cli: CommandLine, tmp_path: Path) -> None:
    seal(ENV, 2, tmp_path / "s.json")
    submit("stp", short, RunOptions(scenes=1), tmp_path)
    path = tmp_path / f"{ENV}.json"
    output = cli("verify", path, "--env", short, "--rerun", "--hidden", tmp_path / "s.json", "--jobs", 1)
    assert output.error.startswith(f"the seal is of {ENV} with card digest")
