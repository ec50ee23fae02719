"""Records: no changed one is taken, and ranks follow from errors per scene alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.errors import MtpBenchError, RecordError
from mtp_bench.records import load_record, ranks, record_paths, save_record, why_unranked
from mtp_bench.records.evaluation import status_of
from mtp_bench.records.provenance import hardware, scene_digest
from mtp_bench.records.record import Record
from mtp_bench.records.sealing import worse_when_moved
from tests.support.command_line import CommandLine
from tests.support.small_scenes import make_scene
from tests.support.stored_records import scene_part, write_record

SCENES = "abcdefgh"


def record_of(*errors: float, name: str = "echo", **changes: Any) -> Record:
    return write_record({scene: [error] for scene, error in zip(SCENES, errors, strict=False)}, name, **changes)


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    record = save_record(record_of(1.0, 2.0), tmp_path / "new" / "a.json")
    assert load_record(tmp_path / "new" / "a.json") == record
    assert len(record.digest) == 64


def test_what_users_write_is_kept_verbatim(tmp_path: Path) -> None:
    text = "<script>alert('ä')</script> [bold] & \"x\" \u202e"
    part = {"name": "echo", "authors": [text], "description": text, "digest": "aa", "parameters": {text: text}}
    save_record(record_of(1.0, submission=part, training_data=[text]), tmp_path / "a.json")
    read = load_record(tmp_path / "a.json")
    assert read.submission.authors == [text]
    assert read.submission.description == text
    assert read.training_data == [text]
    assert "<script>" in (tmp_path / "a.json").read_text(encoding="utf-8")


def test_the_digest_is_of_the_content_not_of_the_file_or_the_level(tmp_path: Path) -> None:
    record = save_record(record_of(1.0), tmp_path / "a.json")
    again = save_record(record.model_copy(update={"verification": "re-run"}), tmp_path / "b.json")
    assert again.digest == record.digest
    content = json.loads((tmp_path / "a.json").read_text())
    (tmp_path / "a.json").write_text(json.dumps(dict(reversed(content.items()))))
    assert load_record(tmp_path / "a.json") == record


CHANGES: dict[str, Callable[[dict[str, Any]], None]] = {
    "error": lambda content: content["rows"][0].update(missing_aware=0.9),
    "name": lambda content: content["submission"].update(name="other"),
    "digest": lambda content: content.update(digest=""),
    "status": lambda content: content.update(status="finished"),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_changed_record_is_refused(change: Callable[[dict[str, Any]], None], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_record(record_of(1.0, status="partial", status_reason="1 of 2 scenes"), path)
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
        ('{"format": 2}', "format 2, expected 1"),
        ('{"format": 1, "seeds": [NaN]}', "NaN is no number of JSON"),
        ('{"format": 1, "seedz": []}', r"unknown key 'seedz': did you mean 'seeds'\?"),
        ('{"format": 1}', "key 'submission' is missing"),
        ("[" * 100_000, "not valid JSON"),
    ],
    ids=["cut", "list", "format", "nan", "typo", "empty", "deep"],
)
def test_what_is_no_record_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(RecordError, match=message):
        load_record(tmp_path / "a.json")


def test_errors_that_do_not_fit_the_seeds_are_refused(tmp_path: Path) -> None:
    part = scene_part("a", 10, [1.0]).model_dump()
    part["errors"]["all"] = []
    save_record(record_of(1.0, per_scene=[part]), tmp_path / "a.json")
    with pytest.raises(RecordError, match="'a' lacks errors"):
        load_record(tmp_path / "a.json")


def test_rows_and_scenes_must_be_complete(tmp_path: Path) -> None:
    record = record_of(1.0, 2.0)
    for seeds in ([], [0, 0], [-1]):
        save_record(record.model_copy(update={"seeds": seeds}), tmp_path / "a.json")
        with pytest.raises(RecordError, match="expected whole numbers from 0 on, each once"):
            load_record(tmp_path / "a.json")
    save_record(record.model_copy(update={"rows": record.rows[1:]}), tmp_path / "a.json")
    with pytest.raises(RecordError, match="rows are of ids, lost, reacquired, frag, expected all, ids"):
        load_record(tmp_path / "a.json")
    save_record(record.model_copy(update={"per_scene": record.per_scene[:1] * 2}), tmp_path / "a.json")
    with pytest.raises(RecordError, match="per_scene has 2 scenes, expected 2, each once"):
        load_record(tmp_path / "a.json")


def test_a_missing_record_and_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"none\.json: no such record; `mtp-bench submit` makes one"):
        load_record(tmp_path / "none.json")
    (tmp_path / "file").touch()
    with pytest.raises(MtpBenchError, match="is a file, expected a folder"):
        save_record(record_of(1.0), tmp_path / "file" / "x" / "a.json")


def test_rollouts_are_no_records(tmp_path: Path) -> None:
    save_record(record_of(1.0), tmp_path / "echo" / "a.json")
    (tmp_path / "echo" / "a.rollouts" / "seed-0").mkdir(parents=True)
    (tmp_path / "echo" / "a.rollouts" / "seed-0" / "run.json").touch()
    assert record_paths(tmp_path) == [tmp_path / "echo" / "a.json"]


def test_entries_whose_interval_covers_zero_share_a_rank() -> None:
    best = record_of(1.0, 2.0, 3.0, 4.0, name="best")
    close = record_of(1.1, 1.9, 3.1, 4.0, name="close")
    far = record_of(2.0, 3.0, 4.0, 5.0, name="far")
    found = ranks([far, close, best])
    assert [found[record.digest]["all"] for record in (best, close, far)] == [1, 1, 3]
    assert found[best.digest]["lost"] is None  # 5 objects
    assert found[best.digest]["ids"] is None


def test_divisions_and_envs_are_ranked_apart() -> None:
    env = {**record_of(1.0).env.model_dump(), "data_manifest": "00"}
    closed, opened = record_of(2.0, 2.0), record_of(1.0, 1.0, name="open", division="open")
    other = record_of(0.5, 0.5, name="other", env=env)
    found = ranks([closed, opened, other])
    assert [found[record.digest]["all"] for record in (closed, opened, other)] == [1, 1, 1]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"status": "partial", "status_reason": "1 of 2 scenes"}, "partial: 1 of 2 scenes"),
        ({"status": "crashed"}, "crashed: "),
        ({"status": "rejected"}, "rejected: "),
        ({"env": {"observe": "truth"}}, "saw the truth"),
        ({"budget": "free"}, "4 samples per object, not the env's own k"),
    ],
)
def test_some_are_shown_never_ranked(changes: dict[str, Any], reason: str) -> None:
    if "env" in changes:
        changes = {"env": {**record_of(1.0).env.model_dump(), **changes["env"]}}
    odd, sound = record_of(0.1, 0.1, name="odd", **changes), record_of(1.0, 1.0)
    assert why_unranked(odd) == reason
    found = ranks([odd, sound])
    assert (found[odd.digest]["all"], found[sound.digest]["all"]) == (None, 1)


def test_who_dies_in_a_scene_is_not_ranked() -> None:
    """Where false forecasts outweigh the right ones, falling silent would gain."""
    lost = {"late": 0, "malformed": 0, "crashed_scenes": 1, "reasons": {"0001|0": "crashed: it fell"}}
    sound, cut = record_of(9.0, 9.0, name="sound"), record_of(1.0, 1.0, name="cut", missed=lost)
    assert why_unranked(cut) == f"1 of {len(cut.seals)} scenes and seeds were cut short"
    found = ranks([sound, cut])
    assert (found[sound.digest]["all"], found[cut.digest]["all"]) == (1, None)


def test_flooding_is_not_ranked_where_false_forecasts_cost_nothing() -> None:
    env = {**record_of(1.0).env.model_dump(), "truth_complete": False}
    stp = record_of(1.0, 1.0, name="stp", env=env)
    flood = record_of(0.1, 0.1, name="flood", env=env, details={"forecasts_per_frame": 4.6})
    assert why_unranked(flood, [stp, flood]) == (
        "forecasts more than 1.5 times as many objects as stp, where false ones cost nothing"
    )
    assert ranks([stp, flood])[flood.digest]["all"] is None
    assert ranks([flood])[flood.digest]["all"] == 1  # nothing to compare with
    complete = [record_of(1.0, 1.0, name="stp"), record_of(0.1, 0.1, details={"forecasts_per_frame": 4.6})]
    assert why_unranked(complete[1], complete) is None


@pytest.mark.parametrize(("error", "worse"), [(1.0, False), (1.15, False), (1.17, True), (2.0, True), (None, False)])
def test_a_submission_scores_alike_under_another_motion(error: float | None, worse: bool) -> None:
    record = write_record({"a": [0.1, 2.0]})  # a table for one seed, and nothing for the other
    assert record.row.missing_aware == pytest.approx(1.05)
    assert (worse_when_moved(record, error) is not None) is worse


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
