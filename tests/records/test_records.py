"""Records: no changed one is taken, and ranks follow from errors per scene alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mtp_bench.errors import MtpBenchError, RecordError
from mtp_bench.gateway import SceneRun
from mtp_bench.records import load_record, read_history, record_paths, save_record, standings, why_unranked
from mtp_bench.records.evaluation import status_of
from mtp_bench.records.provenance import hardware
from mtp_bench.records.record import Record, ScenePart
from mtp_bench.records.rerun import require_whole, worse_when_moved
from mtp_bench.scoring.subsets import Subset
from mtp_bench.sources.digest import scene_digest
from tests.support.command_line import CommandLine
from tests.support.small_scenes import make_scene
from tests.support.stored_records import scene_part, ships_of, write_record


def ranks(*records: Record, subset: Subset = "all") -> list[int | None]:
    found = standings(records, ships=ships_of(*records))
    return [found[record.digest].places[subset].rank for record in records]


def reasons(*records: Record, subset: Subset = "all") -> list[str]:
    found = standings(records, ships=ships_of(*records))
    return [found[record.digest].places[subset].why for record in records]


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    record = save_record(write_record(1.0, 2.0), tmp_path / "new" / "a.json")
    assert load_record(tmp_path / "new" / "a.json") == record
    assert len(record.digest) == 64


def test_what_users_write_is_kept_verbatim(tmp_path: Path) -> None:
    text = "<script>alert('ä')</script> [bold] & \"x\""
    part = {"authors": [text], "description": text, "parameters": {text: text}}
    save_record(write_record(1.0, submission=part, training_data=[text]), tmp_path / "a.json")
    read = load_record(tmp_path / "a.json")
    assert read.submission.authors == [text]
    assert read.submission.description == text
    assert read.training_data == [text]
    assert "<script>" in (tmp_path / "a.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("letter", ["\u202e", "\u200b", "\x1b"], ids=["turns around", "no width", "escape"])
def test_what_nobody_sees_is_refused(letter: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_record(write_record(1.0, training_data=["a sign: $"]), path)
    path.write_text(path.read_text(encoding="utf-8").replace("a sign: $", "a sign: " + json.dumps(letter)[1:-1]))
    with pytest.raises(RecordError, match=r"training_data\[0\] has the character U\+"):
        load_record(path)


def test_the_digest_is_of_the_content_not_of_the_file_or_what_was_measured(tmp_path: Path) -> None:
    record = save_record(write_record(1.0), tmp_path / "a.json")
    assert write_record(1.0, measured={"made": "2031-02-03", "latency": {"p50_ms": 9.0}}).digest == record.digest
    content = json.loads((tmp_path / "a.json").read_text())
    (tmp_path / "a.json").write_text(json.dumps(dict(reversed(content.items()))))
    assert load_record(tmp_path / "a.json") == record


CHANGES: dict[str, Callable[[dict[str, Any]], None]] = {
    "error": lambda content: content["rows"][0].update(error=0.9),
    "name": lambda content: content["submission"].update(name="other"),
    "digest": lambda content: content.update(digest=""),
    "status": lambda content: content.update(status="finished"),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_changed_record_is_refused(change: Callable[[dict[str, Any]], None], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_record(write_record(1.0, status="partial", status_reason="1 of 2 scenes"), path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(RecordError, match=r"a\.json: its content has the digest .* changed after it was made"):
        load_record(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ("[]", "holds list, expected a table"),
        ('{"format": 1}', r"format 1, expected 2: those of definitions 1\.0 rank no more"),
        ('{"format": 2, "seeds": [NaN]}', "NaN is not allowed in JSON"),
        ('{"format": 2, "seedz": []}', r"unknown key 'seedz': did you mean 'seeds'\?"),
        ('{"format": 2}', "key 'submission' is missing"),
        ("[" * 100_000, "not valid JSON"),
    ],
    ids=["cut", "list", "format", "nan", "typo", "empty", "deep"],
)
def test_what_is_no_record_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(RecordError, match=message):
        load_record(tmp_path / "a.json")


BROKEN: dict[str, Callable[[dict[str, Any]], None]] = {
    "missing": lambda part: part["error"].pop("ids"),
    "another number of units": lambda part: part["weight"]["ids"].append(1.0),
    "none": lambda part: part.update(weight={}, error={}),
}


@pytest.mark.parametrize("change", BROKEN.values(), ids=BROKEN)
def test_sums_that_do_not_fit_each_other_are_refused(change: Callable[[dict[str, Any]], None], tmp_path: Path) -> None:
    part = scene_part("a", 10, 1.0, 2.0).model_dump()
    change(part)
    record = write_record(1.0)
    save_record(record.model_copy(update={"per_scene": [ScenePart.model_validate(part)]}), tmp_path / "a.json")
    with pytest.raises(RecordError, match="'a' lacks sums"):
        load_record(tmp_path / "a.json")


def test_a_record_of_too_many_units_is_refused_before_anything_is_drawn_of_them(tmp_path: Path) -> None:
    part = scene_part("a", 10, 1.0, 2.0).model_dump()
    part["weight"], part["error"] = (dict.fromkeys(part[name], [1.0] * 20_000) for name in ("weight", "error"))
    record = write_record(1.0)
    save_record(record.model_copy(update={"per_scene": [ScenePart.model_validate(part)]}), tmp_path / "a.json")
    with pytest.raises(RecordError, match="there are sums of 20000 units, expected at most 2000"):
        load_record(tmp_path / "a.json")


def test_rows_and_scenes_must_be_complete(tmp_path: Path) -> None:
    record = write_record(1.0, 2.0)
    for seeds in ([], [0, 0]):
        save_record(record.model_copy(update={"seeds": seeds}), tmp_path / "a.json")
        with pytest.raises(RecordError, match="expected whole numbers from 0 on, each once"):
            load_record(tmp_path / "a.json")
    save_record(record.model_copy(update={"seeds": [-1, 0, 1]}), tmp_path / "a.json")
    with pytest.raises(RecordError, match=r"seeds\.0: got -1"):
        load_record(tmp_path / "a.json")
    save_record(record.model_copy(update={"rows": record.rows[1:]}), tmp_path / "a.json")
    with pytest.raises(
        RecordError, match="rows are of ids, lost, reacquired, frag, paper_ids, paper_frag, expected all, ids"
    ):
        load_record(tmp_path / "a.json")
    save_record(record.model_copy(update={"per_scene": record.per_scene[:1] * 2}), tmp_path / "a.json")
    with pytest.raises(RecordError, match="per_scene has 2 scenes, expected 2, each once"):
        load_record(tmp_path / "a.json")


def test_a_missing_record_and_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"none\.json: no such record; `mtp-bench submit` makes one"):
        load_record(tmp_path / "none.json")
    (tmp_path / "file").touch()
    with pytest.raises(MtpBenchError, match="is a file, expected a folder"):
        save_record(write_record(1.0), tmp_path / "file" / "x" / "a.json")


def test_rollouts_are_no_records(tmp_path: Path) -> None:
    save_record(write_record(1.0), tmp_path / "echo" / "a.json")
    (tmp_path / "echo" / "a.rollouts" / "seed-0").mkdir(parents=True)
    (tmp_path / "echo" / "a.rollouts" / "seed-0" / "run.json").touch()
    (tmp_path / "echo" / ".b.1.0a.part.json").touch()  # is being written
    left = tmp_path / "echo" / ".a.1.0a.part.rollouts.earlier" / "seed-0"  # by a submit that was killed
    left.mkdir(parents=True)
    (left / "run.json").touch()
    assert record_paths(tmp_path) == [tmp_path / "echo" / "a.json"]
    (tmp_path / "echo").rename(tmp_path / ".mine")
    assert record_paths(tmp_path / ".mine") == [tmp_path / ".mine" / "a.json"], "asked for by its name"


EIGHT = (1.0, 2.0, 3.0, 4.0, 1.5, 2.5, 3.5, 4.5)


def times(factor: float, *more: float) -> list[float]:
    return [factor * error + extra for error, extra in zip(EIGHT, more or [0.0] * 8, strict=True)]


def test_who_is_not_significantly_better_shares_a_rank() -> None:
    best = write_record(*EIGHT, name="best")
    close = write_record(*times(1.0, 0.2, -0.1, 0.3, -0.2, 0.1, -0.1, 0.0, 0.1), name="close")
    far = write_record(*times(1.4), name="far")
    assert ranks(far, close, best) == [3, 1, 1]
    for subset in ("ids", "lost", "paper_ids"):
        assert ranks(far, close, best, subset=subset) == [None] * 3
    assert reasons(far, subset="ids") == ["0.0 objects, fewer than 20"]
    assert reasons(far, subset="lost") == ["shown only"]


def test_units_rank_not_scenes() -> None:
    part = scene_part("a", 10, *EIGHT)
    assert ranks(write_record(1.0, per_scene=[part.model_dump()])) == [1]


def test_four_recordings_rank_nobody() -> None:
    two = write_record(*EIGHT[:4], name="a"), write_record(*times(2.0)[:4], name="b")
    assert ranks(*two) == [None, None]
    assert reasons(*two) == ["too few recordings to rank: 4.0 effective units, fewer than 6"] * 2
    assert all(standing.compared for standing in standings(two, ships=ships_of(*two)).values())


def on_events(record: Record) -> Record:
    """The record with as much weight on ids and reacquired as on all targets."""
    scenes = [
        part.model_copy(
            update={
                n: {**getattr(part, n), **dict.fromkeys(("ids", "reacquired"), getattr(part, n)["all"])}
                for n in ("weight", "error")
            }
        )
        for part in record.per_scene
    ]
    rows = [row.model_copy(update={"effective_objects": 40.0}) for row in record.rows]
    return record.model_copy(update={"per_scene": scenes, "rows": rows})


def test_who_is_worse_than_stp_over_all_targets_is_not_ranked_on_events() -> None:
    stp, good, poor = (
        on_events(write_record(*times(factor), name=name)) for factor, name in ((1.0, "stp"), (0.9, "a"), (1.1, "b"))
    )
    assert ranks(stp, good, poor) == [2, 1, 3]
    assert ranks(stp, good, poor, subset="ids") == [2, 1, None]
    assert reasons(stp, good, poor, subset="ids")[2] == "over all targets its error is above that of stp"
    assert reasons(good, poor, subset="ids") == ["no record of stp beside it"] * 2  # nothing to compare with


def test_divisions_and_envs_are_ranked_apart() -> None:
    closed, opened = write_record(*times(2.0)), write_record(*EIGHT, name="open", division="open")
    other = write_record(*times(0.5), name="other", env={"id": "MTP-Other-v0"})
    assert ranks(closed, opened, other) == [1, None, 1]
    assert reasons(closed, opened)[1] == "open division: rank 1 there"


@pytest.mark.parametrize("other", [{"env": {"data_manifest": "00" * 32}}, {"reference": {"hash": "00" * 32}}], ids=str)
def test_other_data_or_weights_are_not_compared(other: dict[str, Any]) -> None:
    found = ranks(write_record(*EIGHT, name="stp"), write_record(*EIGHT, name="b"), write_record(*times(0.5), **other))
    assert found == [1, 1, None]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"status": "partial", "status_reason": "1 of 2 scenes"}, "partial: 1 of 2 scenes"),
        ({"status": "crashed"}, "crashed: "),
        ({"status": "rejected"}, "rejected: "),
        ({"env": {"observe": "truth"}}, "saw the truth"),
        ({"env": {"observe": "tracks"}}, "not causal: stored tracks, which may have seen the future"),
        ({"budget": "free"}, "4 samples per object, not the env's own k"),
    ],
)
def test_some_are_shown_never_ranked(changes: dict[str, Any], reason: str) -> None:
    odd, sound = write_record(*times(0.1), name="odd", **changes), write_record(*EIGHT)
    assert why_unranked(odd) == reason
    assert ranks(odd, sound) == [None, 1]
    assert reasons(odd, sound) == [reason, ""]


def test_who_dies_in_a_scene_is_not_ranked() -> None:
    lost = {"late": 0, "malformed": 0, "crashed_scenes": 1, "reasons": {"0001|0": "crashed: it fell"}}
    sound, cut = write_record(*times(9.0), name="sound"), write_record(*EIGHT, name="cut", missed=lost)
    assert why_unranked(cut) == f"1 of {cut.runs} scenes and seeds were cut short"
    assert ranks(sound, cut) == [1, None]


@pytest.mark.parametrize(("error", "worse"), [(1.0, False), (1.15, False), (1.17, True), (2.0, True), (None, False)])
def test_a_submission_scores_alike_under_another_motion(error: float | None, worse: bool) -> None:
    record = write_record(1.05)
    moved = [row.model_copy(update={"error": error}) for row in record.rows if row.subset == "all"]
    assert (worse_when_moved(record, moved) is not None) is worse


@pytest.mark.parametrize(
    ("subset", "factor", "worse"),
    [("ids", 1.09, False), ("ids", 1.2, True), ("reacquired", 1.2, True), ("frag", 9.0, False)],
)
def test_so_it_does_on_event_subsets_that_rank(subset: str, factor: float, worse: bool) -> None:
    record = on_events(write_record(*EIGHT))
    rows = [row.model_copy(update={"error": 2.5}) for row in record.rows]
    record = record.model_copy(update={"rows": rows})
    moved = [row.model_copy(update={"error": 2.5 * (factor if row.subset == subset else 1.0)}) for row in rows]
    found = worse_when_moved(record, moved)
    assert (None if found is None else found.what) == (f"error of {subset} under another motion" if worse else None)


def test_who_dies_where_nobody_could_know_is_told_without_a_name() -> None:
    whole = {0: [scene_run("a"), scene_run("b")]}
    require_whole(whole, "a", "of hidden scenes")
    cut = {0: [scene_run("x1", "crashed", "it fell in x1"), scene_run("x2", "rejected", "no")]}
    with pytest.raises(
        RecordError, match=r"^a: runs of hidden scenes were cut short \(crashed, rejected\): 2, expected 0$"
    ):
        require_whole(cut, "a", "of hidden scenes")
    with pytest.raises(RecordError, match=r"^a: answers of hidden scenes came late: 3, "):
        require_whole({0: [scene_run("x1", late=3)]}, "a", "of hidden scenes")


def scene_run(scene: str, status: str = "finished", reason: str = "", late: int = 0) -> SceneRun:
    """How a run ended."""
    rollout = SimpleNamespace(scene=scene)
    return cast("SceneRun", SimpleNamespace(rollout=rollout, status=status, reason=reason, late=late, malformed=0))


def test_status_of_a_record() -> None:
    assert status_of(3, 3, 0, 9) == ("finished", "")
    assert status_of(3, 3, 8, 9) == ("finished", "")  # what is cut short is missing, and that costs
    assert status_of(3, 4, 0, 9) == ("partial", "3 of 4 scenes")
    assert status_of(3, 3, 0, 9, split="train") == ("partial", "3 of 3 scenes of split 'train', not the env's")
    assert status_of(3, 4, 9, 9, {"a|0": "crashed: it fell"}) == ("crashed", "no scene was finished: crashed: it fell")
    broke = {"a|0": "crashed: it fell", "b|1": "rejected: it answered before it was asked"}
    assert status_of(3, 3, 2, 9, broke) == ("rejected", "b|1: it answered before it was asked")


def test_a_manifest_tells_of_every_number_but_not_of_rounding() -> None:
    scene = make_scene()
    shifted = replace(scene, ego=scene.ego + 1e-11)
    assert scene_digest(shifted) == scene_digest(scene)
    box = scene.truth.box.copy()
    box[3, 0] += 0.001
    for other in (
        replace(scene, truth=replace(scene.truth, box=box)),
        replace(scene, name="two"),
        replace(scene, truth_complete=False),
        replace(scene, detections=replace(scene.detections, score=scene.detections.score + 1)),
    ):
        assert scene_digest(other) != scene_digest(scene)


def test_where_a_number_comes_from() -> None:
    machine = hardware()
    assert machine.cores >= 1
    assert machine.cpu


def test_a_folder_without_records(cli: CommandLine, tmp_path: Path) -> None:
    assert cli("verify", tmp_path).error == f"{tmp_path}: no record there, expected files <submission>/<env id>.json"


def test_results_under_earlier_definitions_are_read_for_what_is_shown(tmp_path: Path) -> None:
    row = {"missing_aware": 1.5, "interval": [1.0, 2.0], "coverage": 0.9, "targets": 7}
    old: dict[str, Any] = {
        "format": 1, "submission": {"name": "stp", "digest": "aa"}, "env": {"id": "MTP-A-v0", "keywords": {}},
        "scorer": {"definitions": "1.0"}, "rows": [row, {**row, "missing_aware": None}], "made": "2026-11-20",
    }  # fmt: skip
    (tmp_path / "1.0").mkdir()
    (tmp_path / "1.0" / "b.json").write_text(json.dumps(old))
    (tmp_path / "1.0" / "a.json").write_text(json.dumps({**old, "submission": {"name": "zz"}}))
    found = read_history(tmp_path)
    assert [(each.submission, each.error, each.interval, each.coverage) for each in found] == [
        ("stp", 1.5, (1.0, 2.0), 0.9),
        ("zz", 1.5, (1.0, 2.0), 0.9),
    ]
    assert read_history(tmp_path / "none") == []
    for change, message in (({"made": 3}, "made: got 3"), ({"rows": []}, "no result under earlier definitions")):
        (tmp_path / "1.0" / "a.json").write_text(json.dumps({**old, **change}))
        with pytest.raises(RecordError, match=rf"a\.json: {message}"):
            read_history(tmp_path)
