"""Records: no changed one is taken, and ranks follow from errors per scene alone."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mtp_bench.core.errors import RecordError
from mtp_bench.judge import SceneRun, checked_record, load_record, record_paths, standings, why_unranked
from mtp_bench.judge.records.consistency import inconsistent_sums
from mtp_bench.judge.records.evaluation import status_of
from mtp_bench.judge.records.record import HiddenPart, MissedPart, Record
from mtp_bench.judge.records.rerun import require_answered, worse_when_moved
from mtp_bench.judge.records.storage import content_digest
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.rows import Row
from mtp_bench.sources.cache import scene_digest
from tests.support.small_scenes import make_scene
from tests.support.stored_records import hidden_part, make_row, save_record, scene_part, ships_of, write_record

Content = dict[str, Any]


def ranks(*records: Record, subset: Subset = "all") -> list[int | None]:
    found = standings(records, ships=ships_of(*records))
    return [found[record.digest].places[subset].place for record in records]


def reasons(*records: Record, subset: Subset = "all") -> list[str]:
    found = standings(records, ships=ships_of(*records))
    return [found[record.digest].places[subset].why for record in records]


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    record = save_record(write_record(1.0, 2.0), tmp_path / "new" / "a.json")
    assert (load_record(tmp_path / "new" / "a.json"), len(record.digest)) == (record, 64)


def test_the_digest_is_over_the_content_alone(tmp_path: Path) -> None:
    """Neither the order of keys nor measurements change it."""
    record = save_record(write_record(1.0), tmp_path / "a.json")
    assert write_record(1.0, measured={"made": "2031-02-03", "latency": {"p50_ms": 9.0}}).digest == record.digest
    content = json.loads((tmp_path / "a.json").read_text())
    (tmp_path / "a.json").write_text(json.dumps(dict(reversed(content.items()))))
    assert checked_record(tmp_path / "a.json") == record


OPTIONAL = {name for name, field in Row.model_fields.items() if not field.is_required()}


def test_a_record_without_an_optional_column_loads(tmp_path: Path) -> None:
    """Such as one that was made before the column was added; its digest is over what it holds."""
    save_record(write_record(*[1.0] * 3), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    content["rows"] = [{name: row[name] for name in row if name not in OPTIONAL} for row in content["rows"]]
    content["digest"] = content_digest(content)
    (tmp_path / "a.json").write_text(json.dumps(content))
    record = checked_record(tmp_path / "a.json")
    assert all(getattr(row, name) is None for row in record.rows for name in OPTIONAL)


def units(part: Content, count: int) -> None:
    """Replace the sums of a scene by those of ``count`` units."""
    for name in ("weight", "error"):
        part[name] = dict.fromkeys(part[name], [1.0] * count)


CHANGED = "its content has the digest .* changed after it was made"
SUMS = "expected one sum or more of every subset, equally many of each"
REFUSED: dict[str, tuple[Callable[[Content], Any], str]] = {
    "another error": (lambda c: c["rows"][0].update(error=0.9), CHANGED),
    "another name": (lambda c: c["submission"].update(name="other"), CHANGED),
    "no digest": (lambda c: c.update(digest=""), CHANGED),
    "other times": (lambda c: c["measured"].update(ms_per_frame=0.1), "its section 'measured' has the digest"),
    "a sign that turns text around": (lambda c: c["training_data"].append("\u202e"), r"training_data\.0: .*U\+202E"),
    "a sign without width": (lambda c: c["training_data"].append("\u200b"), r"U\+200B"),
    "a control character": (lambda c: c["versions"].update(numpy="\x1b"), r"versions\.numpy: .*U\+001B"),
    "a subset without sums": (lambda c: c["per_scene"][0]["error"].pop("ids"), SUMS),
    "another number of units": (lambda c: c["per_scene"][0]["weight"]["ids"].append(1.0), SUMS),
    "no sums": (lambda c: c["per_scene"][0].update(weight={}, error={}), SUMS),
    "too many units": (lambda c: units(c["per_scene"][0], 20_000), "there are sums of 20001 units, expected at most"),
    "no seed": (lambda c: c.update(seeds=[]), "expected whole numbers from 0 on, each once"),
    "a seed twice": (lambda c: c.update(seeds=[0, 0]), "expected whole numbers from 0 on, each once"),
    "a negative seed": (lambda c: c["seeds"].append(-1), r"seeds\.3: got -1"),
    "a row too few": (lambda c: c["rows"].pop(0), "holds rows of ids, lost, .*, expected all, ids"),
    "a scene twice": (lambda c: c["per_scene"][1].update(scene="a"), "per_scene has 2 scenes, expected 2, each once"),
    "another format": (lambda c: c.update(format=1), "format: got 1"),
    "another H than declared": (lambda c: c["submission"].update(hypotheses=2), "hypotheses is 1, .* declares 2"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_changed_record_is_refused(what: str, tmp_path: Path) -> None:
    change, message = REFUSED[what]
    save_record(write_record(1.0, 2.0), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    change(content)
    if "digest" not in message:
        content |= {"digest": content_digest(content)}
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(RecordError, match=rf"a\.json: .*{message}"):
        checked_record(tmp_path / "a.json")


TEXTS = {
    "a misspelt key": ('{"format": 2, "seedz": []}', r"unknown key 'seedz': did you mean 'seeds'\?"),
    "no keys": ('{"format": 2}', "key 'submission' is missing"),
}


@pytest.mark.parametrize("what", TEXTS)
def test_other_files_are_refused(what: str, tmp_path: Path) -> None:
    text, message = TEXTS[what]
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(RecordError, match=message):
        checked_record(tmp_path / "a.json")
    with pytest.raises(RecordError, match=r"a\.json: "):
        load_record(tmp_path / "a.json")
    with pytest.raises(RecordError, match=r"none\.json: no such record; `mtp-bench submit` makes one"):
        load_record(tmp_path / "none.json")


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
    for name in ("MTP-A-v0", "MTP-A-v01", "MTP-B-v0"):
        (tmp_path / f"{name}.json").touch()
    assert [path.stem for path in record_paths(tmp_path, "MTP-A-v0")] == ["MTP-A-v0"]


EIGHT = (1.0, 2.0, 3.0, 4.0, 1.5, 2.5, 3.5, 4.5)


def times(factor: float, *more: float) -> list[float]:
    return [factor * error + extra for error, extra in zip(EIGHT, more or [0.0] * 8, strict=True)]


def test_places_follow_the_error() -> None:
    best = write_record(*EIGHT, name="best")
    close = write_record(*times(1.0, 0.2, -0.1, 0.3, -0.2, 0.1, -0.1, 0.0, 0.1), name="close")
    far = write_record(*times(1.4), name="far")
    assert ranks(far, close, best) == [3, 2, 1]
    found = standings([far, close, best], ships=ships_of(far, close, best))
    assert [found[record.digest].places["all"].span for record in (far, close, best)] == [(3, 3), (1, 2), (1, 2)]
    for subset in ("ids", "lost", "paper_ids"):
        assert ranks(far, close, best, subset=subset) == [None] * 3
    assert (reasons(far, subset="ids"), reasons(far, subset="lost")) == (["0.0 objects, fewer than 20"], ["shown only"])


def test_units_rank_not_scenes() -> None:
    assert ranks(write_record(1.0, per_scene=[scene_part("a", 10, *EIGHT).model_dump()])) == [1]


def on_events(record: Record) -> Record:
    """The record with as much weight on ids and reacquired as on all targets."""

    def also(sums: dict[Any, Any]) -> dict[Any, Any]:
        return {**sums, **dict.fromkeys(("ids", "reacquired"), sums["all"])}

    scenes = [part.model_copy(update={n: also(getattr(part, n)) for n in ("weight", "error")})
              for part in record.per_scene]  # fmt: skip
    rows = [row.model_copy(update={"effective_objects": 40.0}) for row in record.rows]
    return record.model_copy(update={"per_scene": scenes, "rows": rows})


def test_envs_are_ranked_apart() -> None:
    other = write_record(*times(0.5), name="other", env={"id": "MTP-Other-v0"})
    assert ranks(write_record(*times(2.0)), other) == [1, 1]


OTHERS = ({"env": {"data_manifest": "00" * 32}}, {"reference": {"hash": "00" * 32}}, {"samples": 40})


@pytest.mark.parametrize("other", OTHERS, ids=str)
def test_other_data_weights_or_samples_are_not_compared(other: dict[str, Any]) -> None:
    found = ranks(write_record(*EIGHT, name="stp"), write_record(*EIGHT, name="b"), write_record(*times(0.5), **other))
    assert found == [1, 1, None]


@pytest.mark.parametrize(("changes", "reason"), [
    ({"status": "partial", "status_reason": "1 of 2 scenes"}, "partial: 1 of 2 scenes"),
    ({"status": "crashed"}, "crashed: "), ({"status": "rejected"}, "rejected: "),
    ({"env": {"observe": "truth"}}, "saw the truth"), ({"budget": "free"}, "4 samples per object, not the env's own k"),
])  # fmt: skip
def test_some_are_shown_never_ranked(changes: dict[str, Any], reason: str) -> None:
    odd, sound = write_record(*times(0.1), name="odd", **changes), write_record(*EIGHT)
    assert (why_unranked(odd), ranks(odd, sound), reasons(odd, sound)) == (reason, [None, 1], [reason, ""])


def test_who_dies_in_a_scene_is_not_ranked() -> None:
    lost = {"late": 0, "malformed": 0, "crashed_scenes": 1, "reasons": {"0001|0": "crashed: it fell"}}
    sound, cut = write_record(*times(9.0), name="sound"), write_record(*EIGHT, name="cut", missed=lost)
    assert (why_unranked(cut), ranks(sound, cut)) == (f"1 of {cut.runs} scenes and seeds were not finished", [1, None])


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
    require_answered({0: [scene_run("a"), scene_run("b")]}, "a", "of hidden scenes")
    cut = {0: [scene_run("x1", "crashed", "it fell in x1"), scene_run("x2", "rejected", "no")]}
    with pytest.raises(RecordError, match=r"^a: 2 runs of hidden scenes .* \(crashed, rejected\), expected 0$"):
        require_answered(cut, "a", "of hidden scenes")


def scene_run(scene: str, status: str = "finished", reason: str = "") -> SceneRun:
    rollout = SimpleNamespace(scene=scene)
    return cast("SceneRun", SimpleNamespace(rollout=rollout, status=status, reason=reason, malformed=0))


FELL, BROKE = "crashed: it fell", "rejected: it answered before it was asked"


@pytest.mark.parametrize(("scenes", "reasons", "status"), [
    (3, [], ("finished", "")),
    (3, [FELL] * 8, ("finished", "")),  # what is cut short is missing, and that costs
    (2, [], ("partial", "2 of 3 scenes")),
    (2, [FELL] * 9, ("crashed", f"no scene was finished: {FELL}")),
    (3, [FELL, BROKE], ("rejected", "1|0: it answered before it was asked")),
])  # fmt: skip
def test_status_of_a_record(scenes: int, reasons: list[str], status: tuple[str, str]) -> None:
    by_run = {f"{i}|0": reason for i, reason in enumerate(reasons)}
    missed = MissedPart(malformed=0, crashed_scenes=len(reasons), reasons=by_run)
    assert status_of(scenes, 3, missed, 9) == status


def test_a_manifest_tells_of_every_number_but_not_of_rounding() -> None:
    scene = make_scene()
    assert scene_digest(replace(scene, ego=scene.ego + 1e-11)) == scene_digest(scene)
    box = scene.truth.box.copy()
    box[3, 0] += 0.001
    for other in (
        replace(scene, truth=replace(scene.truth, box=box)),
        replace(scene, name="two"),
        replace(scene, truth_complete=False),
        replace(scene, detections=replace(scene.detections, score=scene.detections.score + 1)),
    ):
        assert scene_digest(other) != scene_digest(scene)


def test_ends_of_an_interval_hold_where_they_come_from_rounding() -> None:
    """Nearly all targets are missed: sums as they are stored, with 12 digits, give other ends than those of the run."""
    weight = np.random.default_rng(0).uniform(0.3, 5.0, 50)
    error = 2.0 * weight
    error[7] *= 0.999
    content = hidden_part(*[1.0] * 50).model_dump()
    (at,) = (i for i, row in enumerate(content["rows"]) if row["subset"] == "lost")
    row = make_row("echo", "lost", [{"weight": {"lost": weight.tolist()}, "error": {"lost": error.tolist()}}])
    content["rows"][at] = row
    for part, values in (("weight", weight), ("error", error)):
        content[part]["lost"] = [float(f"{value:.12g}") for value in values]
    assert list(inconsistent_sums(HiddenPart.model_validate(content), math.inf)) == []
    row["interval"] = [row["interval"][0], row["interval"][1] + 0.01]
    (said,) = inconsistent_sums(HiddenPart.model_validate(content), math.inf)
    assert said.startswith("row 'lost': interval to is 2.01")
