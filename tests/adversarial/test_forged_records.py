"""Forged records and levels: each is refused, shown without a level, or not ranked, for the reason that it deserves."""

import contextlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent.manifest import read_manifest
from mtp_bench.core.errors import MtpBenchError, RecordError
from mtp_bench.judge import (
    Isolation,
    Limits,
    checked_record,
    digest_of,
    load_record,
    open_seal,
    submit,
    trusted,
    verify,
)
from mtp_bench.judge.records import intake
from mtp_bench.judge.records.attestation import SignedLevel, Statement, read_level, write_level
from mtp_bench.judge.records.eligibility import why_unranked
from mtp_bench.judge.records.fields import Level
from mtp_bench.judge.records.record import HiddenPart, Record
from mtp_bench.judge.records.rerun import why_unsandboxed
from mtp_bench.judge.records.rounds import attest
from mtp_bench.judge.records.seal import Commitment, SecretSeeds, commitment_of
from mtp_bench.judge.records.shipped import baseline_digest, shipped
from mtp_bench.judge.records.storage import content_digest, measured_digest, with_digests
from mtp_bench.judge.records.trust import read_owners
from mtp_bench.judge.records.verifying import Verification
from mtp_bench.running.options import RunOptions
from tests.support.board_records import MAIN, made_up
from tests.support.command_line import CommandLine, write_submission
from tests.support.leaderboards import SIGNER, listed, make_key
from tests.support.programs import require_program
from tests.support.small_scenes import CARD_ID
from tests.support.stored_records import (
    hex_of,
    hidden_part,
    save_record,
    ships_of,
    signed_level,
    standings_of,
    write_record,
)

Content = dict[str, Any]
CLOSED = "}\n"  # the end of a file
Change = Callable[[Content], Any]


def forged(path: Path, record: Record, change: Change) -> Path:
    """A record with a change, and with digests that fit it, as a forger would write them."""
    save_record(record, path)
    content = json.loads(path.read_text())
    change(content)
    with contextlib.suppress(UnicodeEncodeError):  # half a character has no digest
        content["targets_sha256"] = digest_of(content["targets"])
        content["measured"]["digest"] = measured_digest(content)
        content["digest"] = content_digest(content)
    path.write_text(json.dumps(content))
    return path


def why(record: Record, beside: Record | None = None, levels: Mapping[str, SignedLevel] | None = None) -> str:
    records = [record] if beside is None else [record, beside]
    return standings_of(records, levels)[record.digest].places["all"].why


@pytest.fixture
def honest(tmp_path: Path) -> tuple[Path, Record]:
    record = made_up("honest", 0.9)
    path = tmp_path / "records" / "honest" / f"{MAIN}.json"
    assert why_unranked(record) is None
    return path, save_record(record, path)


# --- H4: levels that nobody gave
@pytest.mark.parametrize("key_of_record", ["verification", "hidden"])
def test_a_record_that_states_its_own_level_is_refused(honest: tuple[Path, Record], key_of_record: str) -> None:
    path, _ = honest
    path.write_text(json.dumps(json.loads(path.read_text()) | {key_of_record: "hidden"}))
    for read in (load_record, checked_record):
        with pytest.raises(RecordError, match=f"unknown key '{key_of_record}'"):
            read(path)


@pytest.fixture(scope="module")
def echo(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> tuple[Path, Path]:
    root = tmp_path_factory.mktemp("echo")
    folder = write_submission(root / "echo")
    submit(folder, card, RunOptions(kitti), root / "records")
    return folder, root / "records" / f"{CARD_ID}.json"


@pytest.mark.needs("sandbox")
def test_relabelled_answers_are_found(echo: tuple[Path, Path], card: str, kitti: str, tmp_path: Path) -> None:
    """Stored answers of an agent that saw the truth, relabelled, with a record and a run file that fit them."""
    folder, genuine = echo
    submit("gt_tracks", card, RunOptions(kitti), tmp_path)
    path, own = tmp_path / f"{CARD_ID}.json", load_record(genuine)

    def relabel(content: Content) -> None:
        content["submission"] = own.submission.model_dump()
        content["env"]["observe"] = "detections"
        content["hashes"]["seals"] = "00" * 32
        content["hypotheses"] = own.hypotheses

    forged(path, load_record(path), relabel)
    with pytest.raises(RecordError, match="made with submission"):
        verify(path, RunOptions(kitti), card)
    run = path.with_suffix(".rollouts") / "seed-0" / "run.json"
    content = json.loads(run.read_text())
    content["info"].update(submission_digest=own.submission.digest)
    run.write_text(json.dumps(content))
    with pytest.raises(RecordError, match=r"made with observe 'truth', the record .* says 'detections'"):
        verify(path, RunOptions(kitti), card)
    checked = verify(path, RunOptions(kitti), card, submission=folder, rerun=True)
    assert checked.level == "scored"
    assert "hashes.rollouts" in [difference.what for difference in checked.differences]


@pytest.mark.needs("sandbox")
def test_seals_are_verified_by_another_run(echo: tuple[Path, Path], card: str, kitti: str, tmp_path: Path) -> None:
    folder, genuine = echo
    zeroed: Change = lambda content: content["hashes"].update(seals="00" * 32)  # noqa: E731
    path = forged(tmp_path / "a.json", load_record(genuine), zeroed)
    checked = verify(path, RunOptions(kitti), card, submission=folder, rerun=True)
    assert [difference.what for difference in checked.differences] == ["hashes.seals"]


# --- H5: one record that un-ranks its environment
def broken_counts(content: Content) -> None:
    for part in content["targets"]["subsets"].values():
        part.update(objects=0, effective_objects=0.0)


def other_units(content: Content) -> None:
    """The same targets and errors in twice as many units."""
    content["targets"]["scene_units"] = [2 * count for count in content["targets"]["scene_units"]]
    for part in content["targets"]["subsets"].values():
        part["weight"] = [value / 2 for value in part["weight"] for _ in (0, 1)]
    content["error"] = {name: [value / 2 for value in sums for _ in (0, 1)] for name, sums in content["error"].items()}


def other_data(content: Content) -> None:
    content["env"].update(data_manifest="00" * 32)


@pytest.mark.parametrize("change", [broken_counts, other_units, other_data])
def test_no_record_changes_the_rank_of_another(change: Change) -> None:
    sound = [made_up("stp", 1.0), made_up("a", 0.8), made_up("b", 0.9)]
    content = made_up("odd", 0.1).model_dump()
    change(content)
    content["digest"] = hex_of("odd")
    found = standings_of([Record.model_validate(content), *sound])
    assert [found[record.digest].places["all"].place for record in sound] == [3, 1, 2]
    odd = found[hex_of("odd")]
    assert (odd.compared, odd.places["all"].place) == (False, None)


def test_many_forged_records_do_not_become_the_main_ranking() -> None:
    crowd = [made_up(f"odd_{i}", 0.1 + 0.1 * i, env={"data_manifest": "00" * 32}) for i in range(5)]
    sound = [made_up("stp", 1.0), made_up("a", 0.8)]
    found = standings_of([*crowd, *sound])
    assert [found[record.digest].places["all"].place for record in (*crowd, *sound)] == [None] * 5 + [2, 1]
    assert why(crowd[0], sound[0]) == "other data, scenes or hidden scenes than the ranked ones"


def test_one_broken_record_stops_no_board(honest: tuple[Path, Record], cli: CommandLine) -> None:
    path, _ = honest
    save_record(made_up("stp", 1.0), path.parents[1] / "stp" / path.name)
    (path.parents[1] / "odd").mkdir()
    (path.parents[1] / "odd" / path.name).write_text('{"format": 3, "error": [[]]}')
    content = path.parents[1] / "found.txt"
    said = " ".join(cli.ok("board", "--records", path.parents[1], "--json", content).split())
    assert "refused: " in said
    shown = [(row["submission"], row["place"]) for row in json.loads(content.read_text())[MAIN]]
    assert (shown, cli("board", "--records", path.parents[1], "--strict").status) == ([("honest", 1), ("stp", 2)], 1)


# --- H6: a level where nothing was held
@pytest.mark.needs("sandbox")
def test_what_nothing_held_is_re_scored_at_most(echo: tuple[Path, Path], card: str, kitti: str, tmp_path: Path) -> None:
    folder, genuine = echo
    loose: Change = lambda content: content["isolation"].update(mechanism="none")  # noqa: E731
    path = forged(tmp_path / "a.json", load_record(genuine), loose)
    checked = verify(path, RunOptions(kitti), card, submission=folder, rerun=True)
    assert (checked.holds, checked.level) == (True, "re-scored")
    assert checked.notes == ("limited to level 're-scored': the agent was unsandboxed when the record was made",)


def test_a_stranger_is_not_run_where_nothing_holds_it(
    echo: tuple[Path, Path], card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, genuine = echo
    monkeypatch.setattr("mtp_bench.judge.records.verifying.sandbox_backend", lambda: "none")
    monkeypatch.setattr("mtp_bench.judge.records.verifying.run_again", lambda *_: pytest.fail("it was run"))
    with pytest.raises(RecordError, match=r"no sandbox .*'echo' would run with your rights"):
        verify(genuine, RunOptions(kitti), card, submission=folder, rerun=True)


def test_a_run_that_nothing_held_proves_no_record() -> None:
    record, held = write_record(1.0), Isolation(mechanism="bubblewrap", memory="watch")
    assert why_unsandboxed(record, held) == ""
    assert "in this run" in why_unsandboxed(record, held.model_copy(update={"mechanism": "none"}))


# --- Medium: what ranked and must not
def test_an_agent_that_knows_the_public_scenes_ranks_by_hidden_ones() -> None:
    """36 % worse on hidden scenes was within the intervals once."""
    knows, honest = write_record(*[0.5] * 8, name="knows"), write_record(*[1.0] * 8, name="honest")
    ships = ships_of(knows, simulated=True)
    scale = [1.0 + 0.01 * (i % 7) for i in range(50)]
    parts = {"knows": hidden_part(*[1.36 * s for s in scale]), "honest": hidden_part(*scale)}
    levels = {r.digest: signed_level(r, "hidden", parts[r.submission.name]) for r in (knows, honest)}
    found = standings_of([knows, honest], levels, ships)
    assert [found[r.digest].places["all"].place for r in (knows, honest)] == [2, 1]
    alone = standings_of([knows, honest], {honest.digest: levels[honest.digest]}, ships)
    assert alone[knows.digest].places["all"].why == "not scored on hidden scenes yet"
    assert [alone[record.digest].compared for record in (knows, honest)] == [False, True]
    before = standings_of([knows, honest, write_record(*[2.0] * 8, name="stp")], ships=ships)
    assert before[knows.digest].compared
    assert before[knows.digest].differences["all"].mean == pytest.approx(-1.5), "before a round, on public scenes"


def test_fewer_than_fifty_hidden_scenes_rank_nobody_and_another_seal_ranks_apart() -> None:
    one, two = write_record(*[1.0] * 8, name="one"), write_record(*[1.0] * 8, name="two")
    ships = ships_of(one, simulated=True)
    few = {one.digest: signed_level(one, "hidden", hidden_part(*[1.0] * 49))}
    assert standings_of([one], few, ships)[one.digest].places["all"].why == "scored on 49 hidden scenes, ranks need 50"
    old = signed_level(one, "hidden", hidden_part(*[1.0] * 50, seal="old"), made="2029-01-01", retired="2029-06-01")
    new = signed_level(two, "hidden", hidden_part(*[2.0] * 50), made="2030-01-01")
    found = standings_of([one, two], {one.digest: old, two.digest: new}, ships)
    assert found[two.digest].places["all"].place == 1
    assert found[one.digest].places["all"].why == "other data, scenes or hidden scenes than the ranked ones"


def test_a_seal_that_stp_is_not_on_yet_leads_no_ranking() -> None:
    stp, newcomer = write_record(*[2.0] * 8, name="stp"), write_record(*[1.0] * 8, name="newcomer")
    old = signed_level(stp, "hidden", hidden_part(*[2.0] * 50, seal="old"), made="2029-01-01", retired="2029-06-01")
    new = signed_level(newcomer, "hidden", hidden_part(*[1.0] * 50), made="2030-01-01")
    ships = ships_of(stp, simulated=True)
    found = standings_of([stp, newcomer], {stp.digest: old, newcomer.digest: new}, ships)
    assert found[stp.digest].places["all"].place == 1
    assert found[newcomer.digest].places["all"].why == "other data, scenes or hidden scenes than the ranked ones"


HOUR = Limits(frame=3600.0).model_dump()
NOT_RANKED: dict[str, tuple[Content, str]] = {
    "seeds of one's own": ({"seeds": [3, 4, 5]}, "seeds 3, 4, 5, ranks need 0, 1, 2"),
    "the best of many seeds": ({"seeds": [0, 1, 7]}, "seeds 0, 1, 7, ranks need 0, 1, 2"),
    "an hour per frame": ({"limits": HOUR}, "other limits than those that rank"),
    "own weights": ({"reference": {"hash": "00" * 32}}, "other event weights than the frozen ones"),
    "weights that only say frozen": ({"reference": {"frozen": False}}, "other event weights than the frozen ones"),
    "a card of one's own": ({"env": {"card_digest": "00" * 8}}, "card 0000000000000000, the one that ships is"),
    "an env of one's own": ({"env": {"id": "MTP-Mine-v0"}}, "its environment ships no event weights"),
    "a perfect detector": (
        {"env": {"keywords": {"detector": "perfect"}}}, "other settings of the env: detector 'perfect'",
    ),
    "more samples": ({"env": {"keywords": {"samples": 200}}}, "other settings of the env: samples 200"),
    "earlier definitions": ({"scorer": {"definitions": "2.0"}}, "scored by definitions 2.0, today's are 3.1"),
    "an earlier scorer": ({"scorer": {"source_digest": "00" * 32}}, "another scorer than today's"),
}  # fmt: skip


@pytest.mark.parametrize("what", NOT_RANKED)
def test_other_conditions_are_shown_never_ranked(what: str, tmp_path: Path) -> None:
    changed, reason = NOT_RANKED[what]
    record = save_record(made_up("odd", 0.1, **changed), tmp_path / "a.json")
    assert checked_record(tmp_path / "a.json") == record, "it is consistent, and not ranked"
    sound = made_up("stp", 1.0)
    assert why(record, sound).startswith(reason)
    assert standings_of([record, sound])[sound.digest].places["all"].place == 1


def test_three_scenes_are_not_the_whole_split(tmp_path: Path) -> None:
    few = made_up("few", 0.1, scenes=3, env={"scenes_of_split": 3})
    save_record(few, tmp_path / "a.json")
    assert (checked_record(tmp_path / "a.json").status, why(few)) == ("finished", "3 of 4 scenes")


def test_other_targets_than_the_frozen_ones_do_not_rank() -> None:
    content = made_up("odd", 0.1).model_dump()
    for sums in (content["targets"]["subsets"]["all"]["weight"], content["error"]["all"]):
        sums[:4] = [value / 100 for value in sums[:4]]  # the hard scene made small
    said = "scene 'wildtrack-1200' has other targets than its frozen event weights"
    assert why(Record.model_validate(content)) == said


def of_all(content: Content) -> Content:
    """The targets of the subset "all" in a record."""
    part: Content = content["targets"]["subsets"]["all"]
    return part


def stated(name: str, value: float, subset: str = "all") -> Change:
    return lambda content: content["numbers"][subset].update({name: value})


NO_FACT = "is not a fact that records store"
IMPOSSIBLE: dict[str, tuple[Change, str]] = {
    "negative errors": (
        lambda c: c["error"]["all"].__setitem__(0, -50.0), "got -50.0: Input should be greater than"),
    "more than a miss costs": (
        lambda c: c["error"]["lost"].__setitem__(0, 1e4), "has error 10000, expected 0 to 4 x weight"),
    "errors without targets": (
        lambda c: (c["targets"]["subsets"].pop("lost"), c["error"]["lost"].__setitem__(0, 0.1)), "expected 0 to 4 x we"),
    "a better row": (stated("error", 0.01), NO_FACT),
    "a narrow interval": (lambda c: c["numbers"]["all"].update(interval=[0.9, 0.9]), "interval"),
    "a localisation": (stated("localisation", 0.0), NO_FACT),
    "parts that do not add up": (stated("missed", 3.0), "missed is 3.0, the sums of units give an error of 0.9"),
    "costs that do not": (stated("cost_no_forecast", 9.9), r"the sum of cost_\* is 9.9"),
    "more than all covered": (stated("coverage", 1.5, "ids"), "coverage is 1.5, expected 0 to 1"),
    "a place": (stated("place", 1.0), NO_FACT),
    "a gap": (stated("gap_closed", 0.9), NO_FACT),
    "more than a miss costs by score": (stated("error_by_score", 5.0), "error_by_score is 5.0, expected 0 to 4"),
    "more targets": (lambda c: of_all(c).update(targets=99_999), "targets is 99999, the weights give others"),
    "more objects than targets": (lambda c: of_all(c).update(objects=99_999), "objects is 99999"),
    "more of equal weight": (lambda c: of_all(c).update(effective_objects=1e6), "effective_objects is 1000000"),
    "another agent in a row": (lambda c: c["numbers"]["all"].update(agent="stp"), "agent"),
    "nothing costs much": (
        lambda c: c["targets"].update(nothing_predicted=1e3), "nothing_predicted is 1000.0, expected 0 to 4 m"),
    "a reason of no run": (lambda c: c["missed"].update(reasons={"x|0": "y"}), "'x|0', which is not a run of the record"),
    "finished all the same": (lambda c: c.update(status="finished"), "unknown key 'status'"),
    "more scenes than there are": (lambda c: c["env"].update(scenes_of_split=2), "scenes is 4, the split has 2"),
    "a scene twice": (
        lambda c: c["targets"]["scenes"].__setitem__(1, c["targets"]["scenes"][0]), "of 4 scenes, expected each once"),
    "a level of one's own": (
        lambda c: c.update(converted_from={"digest": "00" * 32, "level": "best"}), r"converted_from\.level: got 'best'"),
    "giant details": (lambda c: c.update(details={}), "unknown key 'details'"),
    "a long reason": (lambda c: c["missed"]["reasons"].update(why="x" * 3000), "at most 2000 characters"),
    "a key that steers the terminal": (
        lambda c: c["submission"]["parameters"].update({"\x1b[2J": 1}), r"contains U\+001B"),
    "half a character": (lambda c: c["submission"]["parameters"].update(a=["\ud800"]), r"surrogate"),
    "nested a thousand times": (lambda c: c["submission"]["parameters"].update(a=nested(900)), "nested deeper"),
    "a number of a thousand digits": (lambda c: c["submission"]["parameters"].update(a=10**1000), "digits"),
}  # fmt: skip


def nested(depth: int) -> Any:
    return [] if depth == 0 else [nested(depth - 1)]


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_what_cannot_be_is_refused(what: str, tmp_path: Path) -> None:
    change, message = IMPOSSIBLE[what]
    with pytest.raises(RecordError, match=message):
        checked_record(forged(tmp_path / "a.json", made_up("odd", 0.9), change))


NO_NAMES = (
    "Stp", "st\u0440", "s tp", "../stp", "x" * 65, "stp\n", "", ".a", "a.", "a..b", "a.part", "a.rollouts", "con",
    "nul.a", "com1", "lpt9.b", "\u0661",
)  # fmt: skip


@pytest.mark.parametrize("name", [*NO_NAMES, "a.b", "console", "part", "a.parts", "9-_"])
def test_names_of_manifests_records_and_owners(name: str, honest: tuple[Path, Record], tmp_path: Path) -> None:
    path, _ = honest
    content = json.loads(path.read_text())
    content["submission"]["name"] = name
    path.write_text(json.dumps(content))
    (tmp_path / "owners.toml").write_text(f'[owners]\n{json.dumps(name)} = "ada"\n')
    folder = write_submission(tmp_path / "a", "placeholder")
    manifest = (folder / "submission.toml").read_text().replace('"placeholder"', json.dumps(name))
    (folder / "submission.toml").write_text(manifest)
    where = (
        (load_record, path, "submission.name"), (read_manifest, folder, "name"),
        (read_owners, tmp_path / "owners.toml", f"owners.{name.strip()}"),
    )  # fmt: skip
    for read, file, key in where:
        if name not in NO_NAMES:
            read(file)
            continue
        with pytest.raises(MtpBenchError) as caught:
            read(file)
        assert f"{key}: got {name!r}: expected at most 64 lower-case" in str(caught.value)


@pytest.mark.parametrize("date", ["9999-99-99", "2026-02-30", "2026-1-1", "0000-01-01", "\u0662026-01-01"])
def test_what_is_not_a_day_is_not_a_date(date: str, honest: tuple[Path, Record]) -> None:
    path, _ = honest
    content = json.loads(path.read_text())
    content["measured"]["made"] = date
    path.write_text(json.dumps(content))
    with pytest.raises(RecordError, match=r"measured\.made: got '"):
        load_record(path)


def test_a_file_of_many_megabytes_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"format": 3, "x": "' + "x" * (9 << 20) + '"}')
    with pytest.raises(RecordError, match=r"more than 8 MiB|larger than 8192 KiB"):
        load_record(tmp_path / "a.json")


def test_a_second_stp_is_no_stp() -> None:
    """It would lift the guard of the event subsets and be the end of every gap."""
    truth = made_up("gt_tracks", 0.4, env={"observe": "truth"})
    agent = made_up("agent", 1.2, submission={"gap_references": "controls"})
    fake, genuine = made_up("stp", 3.0, submission={"digest": hex_of("mine")}), made_up("stp", 1.0)
    assert genuine.submission.digest == baseline_digest("stp")
    found = standings_of([fake, truth, agent])
    assert found[fake.digest].places["all"].why == "'stp' is the name of a baseline, and this is another submission"
    assert found[agent.digest].gaps == {}
    found = standings_of([fake, genuine, truth, agent])
    assert found[agent.digest].gaps["all"] == pytest.approx((1.0 - 1.2) / (1.0 - 0.4))
    assert found[agent.digest].places["ids"].why == "over all targets its bADE is above that of stp"


def test_one_name_has_one_owner() -> None:
    mine, theirs = made_up("agent", 0.5), made_up("agent", 0.9, submission={"digest": hex_of("theirs")})
    reason = "2 submissions have the name 'agent'"
    assert (why(mine, theirs), why(theirs, mine)) == (reason, reason)
    signed = {theirs.digest: signed_level(theirs)}
    assert (why(mine, theirs, signed), why(theirs, mine, signed)) == (reason, "")


# --- levels that are forged, copied, or of somebody else
def sign(path: Path, record: Record, key: Path, level: Level = "re-run", **changed: Any) -> None:
    digests = {"record": record.digest, "measured": record.measured.digest}
    content = {"level": level, "isolation": "bubblewrap", "date": "2030-01-01", **digests, **changed}
    write_level(path, Statement.model_validate(content), key, SIGNER)


def with_level(path: Path, level: object, record: Record | None = None) -> None:
    """Put a level into a file as it is, of ``record`` if one is given."""
    content = json.loads(path.read_text() if record is None else record.model_dump_json())
    path.write_text(json.dumps(content | {"level": level}))


def level_in(path: Path) -> Any:
    return json.loads(path.read_text())["level"]


def note(path: Path, trust: Path) -> str:
    signed, said = read_level(path, load_record(path), trusted(trust))
    assert signed is None
    return said


def test_a_genuine_level_is_shown(honest: tuple[Path, Record], leaderboard: Path, key: Path) -> None:
    """It changes no number of the record, and the signature is of the record alone, however its file is laid out."""
    path, record = honest
    before = path.read_text()
    sign(path, record, key)
    assert path.read_text().startswith(f'{before.removesuffix(CLOSED)},"level":{{')
    assert checked_record(path) == record
    assert save_record(load_record(path), path.with_name("again.json")) == record
    assert path.with_name("again.json").read_text() == before, "a record is never written with a level"
    with_level(path, level_in(path))
    (link := path.with_name("link.json")).symlink_to(path)
    sign(link, record, key)
    assert link.is_symlink()
    signed, said = read_level(path, record, trusted(leaderboard))
    assert said == ""
    assert signed is not None
    assert (signed.statement.level, signed.signer) == ("re-run", SIGNER)


EARLIER = {"digest": "00" * 32, "level": "re-run", "date": "2026-01-01", "signer": "somebody"}


@pytest.mark.parametrize(("level", "converted_from", "message"), [
    ("re-run", EARLIER, ""),
    ("re-run", {**EARLIER, "level": "scored"}, "level 're-run' is converted, the earlier record had 'scored'"),
    ("re-run", None, "level 're-run' is converted, the earlier record had none"),
    ("scored", {**EARLIER, "level": "scored"}, ""),
])  # fmt: skip
def test_a_converted_level_is_that_of_the_earlier_record(
    level: Level, converted_from: Content | None, message: str, leaderboard: Path, key: Path, tmp_path: Path
) -> None:
    path = tmp_path / "records" / "honest" / f"{MAIN}.json"
    record = save_record(made_up("honest", 0.9, converted_from=converted_from), path)
    sign(path, record, key, level, converted=True)
    signed, said = read_level(path, record, trusted(leaderboard))
    assert message in said
    assert (signed is None) == bool(message)
    sign(path, record, key, "scored")
    assert "level 'scored' is signed, expected a higher one" in note(path, leaderboard)


def test_a_converted_record_that_was_not_checked_keeps_no_name() -> None:
    mine, theirs = made_up("agent", 0.5), made_up("agent", 0.9, submission={"digest": hex_of("theirs")})
    reason = "2 submissions have the name 'agent'"
    levels = {theirs.digest: signed_level(theirs, "scored")}
    assert (why(mine, theirs, levels), why(theirs, mine, levels)) == (reason, reason)


def test_a_check_that_reached_less_keeps_a_level(honest: tuple[Path, Record], leaderboard: Path, key: Path) -> None:
    """As on a machine whose sandbox does not hold: the level that is there stays."""
    path, record = honest
    sign(path, record, key)
    again = Verification(path, record, "re-run")
    with pytest.raises(RecordError, match="was replaced while it was checked"):
        attest(replace(again, record=made_up("honest", 0.8)), key, SIGNER, trusted(leaderboard))
    with pytest.raises(RecordError, match=r"reached re-scored, and is re-run since .*: that is kept"):
        attest(replace(again, level="re-scored"), key, SIGNER, trusted(leaderboard))
    for looked_at, stated in ((False, False), (True, True), (False, True)):
        attest(again, key, SIGNER, trusted(leaderboard), looked_at)
        signed, _ = read_level(path, record, trusted(leaderboard))
        assert signed is not None
        assert signed.statement.looked_at is stated


def test_a_level_of_another_record(honest: tuple[Path, Record], leaderboard: Path, key: Path, tmp_path: Path) -> None:
    """Of another submission, of an earlier version of the record, of other times, and of numbers changed on disk."""
    path, record = honest
    other = tmp_path / "records" / "other" / path.name
    sign(other, save_record(made_up("other", 0.2), other), key)
    with_level(path, level_in(other))
    assert "of another record" in note(path, leaderboard)
    sign(path, record, key)
    level = level_in(path)
    with_level(path, level, with_digests(record.model_copy(update={"training_data": ["all of it"]})))
    assert "of another record" in note(path, leaderboard)
    faster = record.measured.model_copy(update={"ms_per_frame": 0.001})
    changed = with_digests(record.model_copy(update={"measured": faster}))
    assert changed.digest == record.digest, "measurements are not part of it"
    with_level(path, level, changed)
    assert "of another record" in note(path, leaderboard)
    better = {subset: [0.5 * value for value in sums] for subset, sums in record.error.items()}
    with_level(path, level, record.model_copy(update={"error": better}))  # with the digests as they were
    assert "of another record" in note(path, leaderboard)
    with_level(path, level, record)
    assert read_level(path, record, trusted(leaderboard))[1] == ""


def test_a_key_that_is_not_listed_is_refused_before_anything_is_run(
    honest: tuple[Path, Record], leaderboard: Path, tmp_path: Path, cli: CommandLine
) -> None:
    path, record = honest
    mine = make_key(tmp_path / "mine")
    sign(path, record, mine)
    assert "not signed by a trusted key" in note(path, leaderboard)
    said = cli.ok("board", "--records", path.parents[1], "--base", leaderboard)
    assert "not signed by a trusted key" in " ".join(said.split())
    arguments = ("verify", path, "--sign", mine, "--signer", SIGNER, "--base", leaderboard)
    assert "its signatures for 'tester' are not trusted" in cli(*arguments).error


@pytest.mark.parametrize(
    "options", ['valid-before="20200101"', 'valid-after="20990101"', 'namespaces="mail"', "revoked"]
)
def test_invalid_keys(options: str, honest: tuple[Path, Record], leaderboard: Path, key: Path, tmp_path: Path) -> None:
    path, record = honest
    sign(path, record, key)
    if options == "revoked":
        revoked, other = leaderboard / "keys" / "revoked_keys", make_key(tmp_path / "other")
        shutil.copy(other.with_name("other.pub"), revoked)
        assert read_level(path, record, trusted(leaderboard))[1] == "", "another key was revoked"
        with revoked.open("a") as file:
            file.write(key.with_name("tester.pub").read_text())
    else:
        (leaderboard / "keys" / "allowed_signers").write_text(listed(key, options=options))
    assert "not signed by a trusted key" in note(path, leaderboard)


STATEMENTS: dict[str, tuple[Change, str]] = {
    "a higher level": (lambda c: c["statement"].update(level="hidden"), "not signed by a trusted key"),
    "another date": (lambda c: c["statement"].update(date="2031-01-01"), "not signed by a trusted key"),
    "another signer": (lambda c: c.update(signer="somebody"), "not signed by a trusted key"),
    "anybody": (lambda c: c.update(signer="*"), "signer: got"),
    "an option as signer": (lambda c: c.update(signer="-Y"), "signer: got"),
    "no signature": (lambda c: c.update(signature=""), "not signed by a trusted key"),
    "more than it knows": (lambda c: c["statement"].update(rank=1), "unknown key 'level.statement.rank'"),
    "a long signature": (lambda c: c.update(signature="x" * 1999 * 11), "characters"),
    "no statement": (lambda c: c.pop("statement"), "key 'level.statement' is missing"),
    "an unknown key": (lambda c: c.update(statment=1), "unknown key 'level.statment'"),
    "an endless number": (lambda c: c["statement"].update(looked_at=float("nan")), "looked_at: "),
}


@pytest.mark.parametrize("what", STATEMENTS)
def test_a_changed_statement_is_not_shown(what: str, honest: tuple[Path, Record], leaderboard: Path, key: Path) -> None:
    path, record = honest
    change, message = STATEMENTS[what]
    sign(path, record, key)
    level = level_in(path)
    change(level)
    with_level(path, level)
    assert message in note(path, leaderboard)
    assert load_record(path) == record, "it costs the level, not the record"


@pytest.mark.parametrize("signed", ["a", "honest", "z"])
def test_of_two_copies_of_a_record_the_one_with_a_level_is_shown(
    signed: str, honest: tuple[Path, Record], leaderboard: Path, key: Path, cli: CommandLine
) -> None:
    path, record = honest
    for name in ("a", "z"):
        shutil.copytree(path.parent, path.parents[1] / name)
    sign(path.parents[1] / signed / path.name, record, key)
    said = "".join(cli.ok("board", "--records", path.parents[1], "--base", leaderboard).split())  # lines are wrapped
    assert "re-run" in said
    others = {"a", "honest", "z"} - {signed}
    for name in others:
        assert f"{path.parents[1] / name / path.name}:acopyof{path.parents[1] / signed / path.name},which" in said
    alone = path.parents[2] / "unsigned"
    shutil.copytree(path.parents[1] / others.pop(), alone / "honest")
    with_it = ("board", "--records", alone, "--base", leaderboard, "--with", path.parents[1] / signed / path.name)
    assert "re-run" in cli.ok(*with_it)


def test_without_ssh_keygen_no_level_is_shown_and_that_is_said(
    honest: tuple[Path, Record], leaderboard: Path, key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, record = honest
    sign(path, record, key)
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path))
    found = os.environ["PATH"]
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "ssh-keygen is not installed" in note(path, leaderboard)
    monkeypatch.setenv("PATH", found)
    assert read_level(path, record, trusted(leaderboard))[1] == ""
    monkeypatch.setenv("PATH", str(tmp_path))
    assert read_level(path, record, trusted(leaderboard))[1] == "", "its signature was checked before"
    with path.open("a") as file:
        file.write("\n")
    assert "ssh-keygen is not installed" in note(path, leaderboard), "of other bytes it was not"


SIMULATED = "MTP-Merge-v0"


@pytest.fixture
def on_seal(leaderboard: Path, tmp_path: Path) -> tuple[Path, Record, Commitment]:
    """A record of a simulated env, and a seal of two scenes that is listed."""
    known = shipped(SIMULATED)
    assert known is not None
    seeds = SecretSeeds(env=SIMULATED, card_digest=known.card, first=2**50, count=2, salt="s" * 64)
    to = commitment_of(seeds)
    promise = Commitment(env=SIMULATED, card_digest=known.card, count=2, commitment=to, made="2030-01-01")
    (leaderboard / "seals" / "first.commitment.json").write_text(promise.model_dump_json())
    path = tmp_path / "records" / "agent" / f"{SIMULATED}.json"
    return path, save_record(made_up("agent", 0.5, SIMULATED, spread=0.05), path), promise


def sealed_part(promise: Commitment, **changed: Any) -> HiddenPart:
    return hidden_part(1.0, 2.0, **({"commitment": promise.commitment} | changed))


def test_a_hidden_part_of_its_seal(on_seal: tuple[Path, Record, Commitment], leaderboard: Path, key: Path) -> None:
    path, record, promise = on_seal
    sign(path, record, key, "hidden", hidden=sealed_part(promise))
    signed, said = read_level(path, record, trusted(leaderboard))
    assert signed is not None, said
    assert why_unranked(record, signed.statement.hidden) == "scored on 2 hidden scenes, ranks need 50"


def test_a_hidden_part_without_its_seal(on_seal: tuple[Path, Record, Commitment], leaderboard: Path, key: Path) -> None:
    path, record, promise = on_seal
    sign(path, record, key, "hidden", hidden=sealed_part(promise, commitment=hex_of("of nobody")))
    assert "its hidden scenes are of no seal" in note(path, leaderboard)
    sign(path, record, key, "hidden", hidden=hidden_part(1.0, 2.0, 3.0, commitment=promise.commitment))
    assert "3 hidden scenes" in note(path, leaderboard)
    part = sealed_part(promise)
    numbers = {**part.numbers, "all": {**part.numbers["all"], "missed": 2.0}}
    sign(path, record, key, "hidden", hidden=part.model_copy(update={"numbers": numbers}))
    assert "hidden scenes: numbers.all: missed is 2.0, the sums of units give an error of 1.5" in note(
        path, leaderboard
    )
    sign(path, record, key, "hidden", hidden=part.model_copy(update={"error": {**part.error, "all": [1.0]}}))
    assert "hidden scenes: error.all has 1 units, its targets 2" in note(path, leaderboard)
    sign(path, record, key, "re-run", hidden=sealed_part(promise))
    assert "level 're-run' with hidden scenes" in note(path, leaderboard)
    sign(path, record, key, "hidden")
    assert "level 'hidden' without hidden scenes" in note(path, leaderboard)


def test_public_scenes_are_not_hidden(on_seal: tuple[Path, Record, Commitment], leaderboard: Path, key: Path) -> None:
    """A seal whose seeds are those of a split of the card cannot be opened, let alone signed."""
    _, _, promise = on_seal
    content = {"env": SIMULATED, "card_digest": promise.card_digest, "first": 10_000, "count": 50, "salt": "s" * 64}
    secret = leaderboard / "public.json"
    secret.write_text(json.dumps(content))
    with pytest.raises(RecordError, match="first: got 10000"):
        open_seal(secret)


# --- what a pull request brings
@pytest.fixture
def proposal(leaderboard: Path, tmp_path: Path) -> Path:
    """A copy of the leaderboard with a record of a new submission, and its owner."""
    folder = tmp_path / "head" / "leaderboard"
    shutil.copytree(leaderboard, folder)
    save_record(made_up("newcomer", 0.9), folder / "records" / "newcomer" / f"{MAIN}.json")
    (folder / "owners.toml").write_text('[owners]\nnewcomer = "ada"\n')
    return folder


def taken(cli: CommandLine, proposal: Path, leaderboard: Path) -> str:
    """The error of the intake; empty if it accepts the proposal."""
    output = cli("maintain", "intake", proposal, "--base", leaderboard, "--owner", "ada")
    return "" if output.status == 0 else output.error


def test_a_proposal_is_taken_in(cli: CommandLine, proposal: Path, leaderboard: Path) -> None:
    said = cli.ok("maintain", "intake", proposal, "--base", leaderboard, "--owner", "Ada")
    assert f"newcomer/{MAIN}.json: can be taken in" in "".join(said.split("\n"))
    assert "a round needs `source`" in " ".join(said.split())
    said = cli.ok("maintain", "intake", leaderboard, "--base", leaderboard, "--owner", "Ada")
    assert "no record to take in" in said
    (proposal / "records" / "newcomer").rename(proposal / "records" / "mtp2")
    writes("owners.toml", '[owners]\nmtp2 = "ada"\n')(proposal, leaderboard)
    output = cli("maintain", "intake", proposal, "--base", leaderboard, "--owner", "Ada")
    assert "'mtp2' is close to 'mtp': may readers take one for the other?" in output.out


def test_a_record_with_answers_of_another_gets_a_note(cli: CommandLine, proposal: Path, leaderboard: Path) -> None:
    path = proposal / "records" / "mtp" / f"{MAIN}.json"
    for root in (proposal, leaderboard):
        copied = made_up("mtp", 0.7, hashes={"seals": hex_of("a"), "rollouts": hex_of("b")})
        save_record(copied, root / path.relative_to(proposal))
    for hashes, same in ((("a", "c"), True), (("c", "b"), True), (("c", "d"), False)):
        seals, rollouts = map(hex_of, hashes)
        save_record(made_up("newcomer", 0.9, hashes={"seals": seals, "rollouts": rollouts}), proposal / NEWCOMER)
        said = " ".join(cli.ok("maintain", "intake", proposal, "--base", leaderboard, "--owner", "ada").split())
        assert ("gives the same answers as mtp" in said) == same
        assert "`training_data` in submission.toml is empty" in said


def test_intake_looks_at_every_owner_twice(proposal: Path, leaderboard: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def look(name: str) -> str:
        seen.append(name)
        return name

    monkeypatch.setattr(intake, "_look", look)
    others = "".join(f'x{i:04d} = "bob"\n' for i in range(1000))
    (leaderboard / "owners.toml").write_text(f"[owners]\n{others}")
    (proposal / "owners.toml").write_text(f"{OWNED}{others}" + "".join(f'y{i} = "ada"\n' for i in range(19)))
    intake.take_in(proposal, trusted(leaderboard), "ada")
    assert 1000 < len(seen) < 2400, "twice for every owner, whatever is new"


@pytest.mark.needs("bash")
@pytest.mark.parametrize(("changed", "status"), [
    (b"leaderboard/records/a/b.json\nleaderboard/owners.toml", 0), (b"leaderboard/records/\xff/b.json", 0),
    (b"leaderboard/records/\xff/b.json\nmtp_bench/errors.py", 1), (b"leaderboard/records/a\n\xff.py", 1),
    (b"leaderboard/ownersXtoml", 1),
])  # fmt: skip
def test_the_workflow_compares_names_by_bytes(changed: bytes, status: int, repository: Path, tmp_path: Path) -> None:
    import yaml

    steps = yaml.safe_load((repository / ".github/workflows/records.yml").read_text())["jobs"]["intake"]["steps"]
    (script,) = (step["run"] for step in steps if "gh api" in step.get("run", ""))
    (tmp_path / "changed").write_bytes(changed)
    (tmp_path / "gh").write_text(f"#!/bin/sh\ncat {tmp_path}/changed\n")
    (tmp_path / "gh").chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "LC_ALL": "C.UTF-8", "REPOSITORY": "a/b", "NUMBER": "1"}
    done = subprocess.run(["bash", "-e", "-c", script], env=environment, capture_output=True, check=False)
    assert done.returncode == status


def test_refusals_are_short(cli: CommandLine, proposal: Path, leaderboard: Path) -> None:
    """Rollouts are named once, and of many refusals the first are shown."""
    stored = proposal / "records" / "newcomer" / f"{MAIN}.rollouts" / "seed-0"
    stored.mkdir(parents=True)
    for i in range(50):
        (stored / f"{i}.npz").touch()
    said = taken(cli, proposal, leaderboard)
    assert said.count("stored rollouts stay with their makers") == 1
    assert len(said) < 500
    for i in range(50):
        (proposal / f"thesis-{i}.tex").touch()
    assert taken(cli, proposal, leaderboard).endswith("; and 41 more")


Proposal = Callable[[Path, Path], Any]  # of the proposed and the trusted leaderboard


def writes(name: str, text: str) -> Proposal:
    return lambda proposal, _: (proposal / name).write_text(text)


def adds(name: str, trusted_too: bool = False, **changed: Any) -> Proposal:
    def change(proposal: Path, leaderboard: Path) -> None:
        for folder in (proposal, leaderboard)[: 1 + trusted_too]:
            save_record(made_up(name, 0.5, **changed), folder / "records" / name / f"{MAIN}.json")

    return change


def as_link(proposal: Path, leaderboard: Path) -> None:
    path = proposal / NEWCOMER
    path.rename(leaderboard.parent / "x.json")
    path.symlink_to(leaderboard.parent / "x.json")


def of_somebody_else(proposal: Path, leaderboard: Path) -> None:
    for folder in (leaderboard, proposal):
        (folder / "owners.toml").write_text('[owners]\nnewcomer = "bob"\n')


def levels(name: str, ours: object = None, theirs: object = None) -> Proposal:
    """A record in the proposal and in the trusted leaderboard, with these levels; None: without."""

    def change(proposal: Path, leaderboard: Path) -> None:
        adds(name, trusted_too=True)(proposal, leaderboard)
        for folder, level in ((proposal, ours), (leaderboard, theirs)):
            if level is not None:
                with_level(folder / "records" / name / f"{MAIN}.json", level)

    return change


def with_a_submodule(proposal: Path, _: Path) -> None:
    """In git's commit alone, without a folder on disk."""
    require_program("git")
    entry = f"160000,{'1' * 40},{proposal.name}/records/evil"
    commit = ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "-m", "a"]
    for words in (["init", "-q"], ["add", "."], ["update-index", "--add", "--cacheinfo", entry], commit):
        subprocess.run(["git", "-C", proposal.parent, *words], check=True)


def without_a_commit(proposal: Path, _: Path) -> None:
    """Git fails as where it refuses the owner of the folder."""
    require_program("git")
    subprocess.run(["git", "-C", proposal.parent, "init", "-q"], check=True)


def below_another_repository(proposal: Path, _: Path) -> None:
    """Git finds that one, and lists none of the files."""
    require_program("git")
    subprocess.run(["git", "-C", proposal.parent, "init", "-q"], check=True)
    commit = ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty", "-m", "a"]
    subprocess.run(["git", "-C", proposal.parent, *commit], check=True)
    (proposal / ".git").symlink_to("nowhere")


def with_a_key_twice(proposal: Path, _: Path) -> None:
    text = (proposal / NEWCOMER).read_text()
    (proposal / NEWCOMER).write_text(text.replace("{", '{"format":3,', 1))


def with_nan(proposal: Path, _: Path) -> None:
    content = json.loads((proposal / NEWCOMER).read_text())
    content["submission"]["parameters"]["a"] = float("nan")
    (proposal / NEWCOMER).write_text(json.dumps(content))


def with_an_entry_of_a_file(proposal: Path, _: Path) -> None:
    (proposal / "files").mkdir()
    (proposal / "files" / "mine.json").write_text("{}")


NEWCOMER = Path("records", "newcomer", f"{MAIN}.json")
OWNED = '[owners]\nnewcomer = "ada"\n'
LEVEL_KEPT = f"{NEWCOMER}: levels are written and removed by those who check records: leave `level` out, or bring"
OLD: Content = {"scorer": {"definitions": "2.0"}}
PROPOSALS: dict[str, tuple[Proposal, str]] = {
    "a level": (lambda head, _: with_level(head / NEWCOMER, {}), LEVEL_KEPT),
    "a file of a level": (writes(f"records/newcomer/{MAIN}.level.json", "{}"), "level.json: key 'error' is missing"),
    "a link": (as_link, f"{NEWCOMER}: link, expected a file of mode 100644"),
    "a pipe": (lambda head, _: os.mkfifo(head / "records" / "newcomer" / "x.json"), "newcomer/x.json: FIFO, expected"),
    "an executable file": (lambda head, _: (head / NEWCOMER).chmod(0o755), f"{NEWCOMER}: executable file, expected"),
    "an empty folder": (lambda head, _: (head / "records" / "evil").mkdir(), "records/evil: empty folder or submodule"),
    "a submodule": (with_a_submodule, "records/evil: git mode 160000, expected a file of mode 100644"),
    "a repository above it": (below_another_repository, "file that is not in git's commit, expected a file of mode 100644"),
    "a clone that git does not list": (without_a_commit, "git cannot list its files (fatal: Not a valid object name HEAD)"),
    "another folder": (
        lambda head, _: (head / "records" / "newcomer").rename(head / "records" / "other"), "expected it at newcomer/"),
    "code": (writes("records/newcomer/agent.py", "print(1)"), "agent.py: expected records/<submission>/<env id>.json"),
    "a key": (writes("keys/allowed_signers", "me ssh-ed25519 AAAA\n"), "keys/allowed_signers: expected records/"),
    "an entry of a file": (with_an_entry_of_a_file, "files/mine.json: "),
    "a seal": (writes("seals/mine.commitment.json", "{}"), "seals/mine.commitment.json: expected records/"),
    "no owner": (writes("owners.toml", "[owners]\n"), "the name 'newcomer' does not have an owner"),
    "a name for another": (
        writes("owners.toml", '[owners]\nnewcomer = "bob"\n'), "gives 'newcomer' to 'bob', expected 'ada'"),
    "a look-alike": (writes("owners.toml", f'{OWNED}s_t-p = "ada"\n'), "'s_t-p' looks like 'stp', which is taken"),
    "letters that look like one": (writes("owners.toml", f'{OWNED}rntp = "ada"\n'), "'rntp' looks like 'mtp', which"),
    "the name of a baseline": (writes("owners.toml", f'{OWNED}stp = "ada"\n'), "'stp' is taken: choose another name"),
    "two that look alike": (
        writes("owners.toml", f'{OWNED}new-comer = "ada"\n'), "'new-comer' looks like 'newcomer', which is taken"),
    "an odd name": (writes("records/newcomer/a\x1b[2J\u202e.json", "{}"), "records/newcomer/a\ufffd[2J\ufffd.json: "),
    "a name for later": (
        writes("owners.toml", f'{OWNED}later = "ada"\n'),
        "'later' has no record: a name comes with the first record of it"),
    "an odd name of an owner": (
        writes("owners.toml", f'{OWNED}"<b>later</b>" = "ada"\n'), "owners.<b>later</b>: got '<b>later</b>': expected"),
    "many names": (
        writes("owners.toml", OWNED + "".join(f'"x{i:02d}" = "ada"\n' for i in range(20))),
        "21 new names, expected at most 20 in one proposal"),
    "a date to come": (
        adds("newcomer", measured={"made": "2999-12-31"}), f"{NEWCOMER}: made on 2999-12-31, expected a day up to"),
    "labelled detections": (adds("newcomer", env={"observe": "associated"}), "records of it are of baselines alone"),
    "a record of a baseline": (adds("stp"), "'stp' is a baseline, only maintainers make its records"),
    "a name that is taken over": (
        lambda _, base: (base / "owners.toml").write_text('[owners]\nnewcomer = "bob"\n'),
        "'newcomer' belongs to 'bob': only maintainers change that"),
    "a record of somebody else": (of_somebody_else, "the name 'newcomer' belongs to 'bob', not to 'ada'"),
    "a removed record": (lambda _, base: adds("theirs")(base, base), "is removed; only maintainers remove files"),
    "a removed level": (levels("newcomer", None, {"a": 1}), LEVEL_KEPT),
    "a rival's level": (levels("theirs", None, {"a": 1}), f"theirs/{MAIN}.json: levels are written and removed by"),
    "an older level": (levels("newcomer", {"a": 0}, {"a": 1}), LEVEL_KEPT),
    "a conversion": (adds("newcomer", converted_from=EARLIER), "only maintainers convert records"),
    "another card": (adds("newcomer", env={"card_digest": "00" * 8}), "with card 0000000000000000 does not ship"),
    "a record of definitions 2.0": (adds("newcomer", **OLD), "scored by definitions 2.0, today's are 3.1: make it"),
    "a key twice": (with_a_key_twice, "key 'format' comes twice"),
    "NaN": (with_nan, "NaN is not allowed in JSON"),
}  # fmt: skip


@pytest.mark.parametrize("what", PROPOSALS)
def test_a_proposal_is_refused_for(what: str, cli: CommandLine, proposal: Path, leaderboard: Path) -> None:
    change, message = PROPOSALS[what]
    change(proposal, leaderboard)
    assert message in taken(cli, proposal, leaderboard)


@pytest.mark.parametrize("name", ["gt_tracks", "perfect_association"])
def test_a_baseline_that_saw_more_cannot_state_that_it_did_not(name: str) -> None:
    found = standings_of([made_up("stp", 1.0), record := made_up(name, 0.1)])
    assert found[record.digest].places["all"].why.startswith("observe is 'detections', the baseline of that name has")
