"""Records: no changed one is taken, and ranks follow from errors per unit alone."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mtp_bench.core.errors import RecordError
from mtp_bench.judge import SceneRun, checked_record, digest_of, load_record, record_paths, why_unranked
from mtp_bench.judge.records import targets as target_files
from mtp_bench.judge.records.canonical import canonical
from mtp_bench.judge.records.record import Record
from mtp_bench.judge.records.rerun import require_answered, worse_when_moved
from mtp_bench.judge.records.storage import content_digest
from mtp_bench.judge.records.targets import UnitTargets, targets_path
from mtp_bench.scoring.definitions import Subset
from mtp_bench.sources.cache import scene_digest
from tests.support.small_scenes import make_scene
from tests.support.stored_records import save_record, scene_part, ships_of, standings_of, write_record

Content = dict[str, Any]


def ranks(*records: Record, subset: Subset = "all") -> list[int | None]:
    found = standings_of(records, ships=ships_of(*records))
    return [found[record.digest].places[subset].place for record in records]


def reasons(*records: Record, subset: Subset = "all") -> list[str]:
    found = standings_of(records, ships=ships_of(*records))
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


def test_a_record_without_a_newer_number_loads(tmp_path: Path) -> None:
    """Such as one that was made before the metric was added."""
    record = write_record(*[1.0] * 3)
    numbers: dict[str, dict[str, float]] = {subset: {} for subset in record.numbers}
    save_record(record.model_copy(update={"numbers": numbers}), tmp_path / "a.json")
    row = checked_record(tmp_path / "a.json").row
    assert (row.minADE, row.energy_score, row.localisation, row.error) == (None, None, None, 1.0)


def as_text(targets: UnitTargets) -> str:
    return canonical(targets.model_dump(mode="json")).decode()


def test_targets_are_those_of_the_leaderboard_or_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of the leaderboard is named by its sha256: another one in its place is refused."""
    monkeypatch.setattr(target_files, "_by_digest", {})
    record = write_record(1.0, 2.0)
    path = tmp_path / "records" / "echo" / "a.json"
    save_record(record, path)
    assert load_record(path).targets == record.targets, "no leaderboard has them, so they are in the file"
    content = json.loads(path.read_text())
    del content["targets"]
    path.write_text(json.dumps(content))
    target_files._by_digest.clear()
    with pytest.raises(RecordError, match=r"there is no file .*targets/MTP-Small-v0"):
        load_record(path)
    file = targets_path(tmp_path, "MTP-Small-v0", record.targets_sha256)
    file.parent.mkdir()
    file.write_text(as_text(record.targets))
    assert checked_record(path).targets == record.targets
    target_files._by_digest.clear()
    file.write_text(as_text(write_record(1.0, 2.0, 3.0).targets))
    with pytest.raises(RecordError, match=r"MTP-Small-v0\..*: these targets have the sha256 .* they were changed"):
        load_record(path)
    file.write_text("{}")
    with pytest.raises(RecordError, match="key 'scenes' is missing"):
        load_record(path)


CHANGED = "its content has the digest .* changed after it was made"
REFUSED: dict[str, tuple[Callable[[Content], Any], str]] = {
    "another error": (lambda c: c["error"]["all"].__setitem__(0, 0.1), CHANGED),
    "another name": (lambda c: c["submission"].update(name="other"), CHANGED),
    "no digest": (lambda c: c.update(digest=""), CHANGED),
    "other times": (lambda c: c["measured"].update(ms_per_frame=0.1), "its section 'measured' has the digest"),
    "a sign that turns text around": (lambda c: c["training_data"].append("\u202e"), r"training_data\.0: .*U\+202E"),
    "a sign without width": (lambda c: c["training_data"].append("\u200b"), r"U\+200B"),
    "a control character": (lambda c: c["versions"].update(numpy="\x1b"), r"versions\.numpy: .*U\+001B"),
    "a subset without sums": (lambda c: c["error"].pop("ids"), "error has no sums of ids"),
    "another number of units": (lambda c: c["error"]["ids"].append(1.0), "error.ids has 3 units, its targets 2"),
    "other targets": (lambda c: c.update(targets_sha256="00" * 32), "these targets have the sha256"),
    "no scenes": (lambda c: c["targets"].update(scenes=[], scene_units=[]), "name no scene"),
    "other weights": (lambda c: c["targets"]["subsets"]["all"]["weight"].pop(), "expected one weight per unit"),
    "no sums": (lambda c: c.update(error={}), "error has no sums of all, ids"),
    "too many units": (lambda c: c["error"].update(all=[1.0] * 20_001), "at most 2000 items"),
    "a curve of text": (lambda c: c.update(curve=[["a", 1.0]]), r"curve\.0"),
    "a curve without errors": (lambda c: c.update(curve=[[1.0]]), r"curve\.0"),
    "a curve below 0": (lambda c: c.update(curve=[[0.0, -1e308], [1.0, 1e308]]), r"curve\.0"),
    "no seed": (lambda c: c.update(seeds=[]), "expected whole numbers from 0 on, each once"),
    "a seed twice": (lambda c: c.update(seeds=[0, 0]), "expected whole numbers from 0 on, each once"),
    "a negative seed": (lambda c: c["seeds"].append(-1), r"seeds\.3: got -1"),
    "another format": (lambda c: c.update(format=2), "format: got 2"),
    "another H than declared": (lambda c: c["submission"].update(hypotheses=2), "hypotheses is 1, .* declares 2"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_changed_record_is_refused(what: str, tmp_path: Path) -> None:
    change, message = REFUSED[what]
    save_record(write_record(1.0, 2.0), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    change(content)
    if "these targets" not in message:
        content["targets_sha256"] = digest_of(content["targets"])
    if "digest" not in message:
        content |= {"digest": content_digest(content)}
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(RecordError, match=rf"a\.json: .*{message}"):
        checked_record(tmp_path / "a.json")


TEXTS = {
    "a misspelt key": ('{"format": 3, "seedz": []}', r"unknown key 'seedz': did you mean 'seeds'\?"),
    "no keys": ('{"format": 3}', "key '.*' is missing"),
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
    found = standings_of([far, close, best], ships=ships_of(far, close, best))
    assert [found[record.digest].places["all"].span for record in (far, close, best)] == [(3, 3), (1, 2), (1, 2)]
    for subset in ("ids", "lost", "paper_ids"):
        assert ranks(far, close, best, subset=subset) == [None] * 3
    assert (reasons(far, subset="ids"), reasons(far, subset="lost")) == (["0.0 objects, fewer than 20"], ["shown only"])


def test_units_rank_not_scenes_and_envs_are_ranked_apart() -> None:
    assert ranks(write_record(scenes=[scene_part("a", 10, *EIGHT)])) == [1]
    other = write_record(*times(0.5), name="other", env={"id": "MTP-Other-v0"})
    assert ranks(write_record(*times(2.0)), other) == [1, 1]


def on_events(record: Record) -> Record:
    """The record with as much weight on ids and reacquired as on all targets."""
    subsets = ("ids", "reacquired")
    targets = record.targets.model_dump()
    targets["subsets"] |= dict.fromkeys(subsets, targets["subsets"]["all"])
    content = record.model_dump() | {
        "targets": targets,
        "error": record.error | dict.fromkeys(subsets, record.error["all"]),
    }
    return Record.model_validate(content)


OTHERS = ({"env": {"data_manifest": "00" * 32}}, {"reference": {"hash": "00" * 32}}, {"samples": 40})


@pytest.mark.parametrize("other", OTHERS, ids=str)
def test_other_data_weights_or_samples_are_not_compared(other: dict[str, Any]) -> None:
    found = ranks(write_record(*EIGHT, name="stp"), write_record(*EIGHT, name="b"), write_record(*times(0.5), **other))
    assert found == [1, 1, None]


@pytest.mark.parametrize(("changes", "reason"), [
    ({"env": {"scenes_of_split": 9}}, "partial: 8 of 9 scenes"),
    ({"missed": {"reasons": {"a|0": "rejected: no"}}}, "rejected: a|0: no"),
    ({"env": {"observe": "truth"}}, "saw the truth"), ({"samples": 5}, "5 samples per object, not the env's own k"),
])  # fmt: skip
def test_some_are_shown_never_ranked(changes: dict[str, Any], reason: str) -> None:
    odd, sound = write_record(*times(0.1), name="odd", **changes), write_record(*EIGHT)
    found = standings_of([odd, sound], ships=ships_of(sound))
    places = [found[record.digest].places["all"] for record in (odd, sound)]
    assert [(place.place, place.why) for place in places] == [(None, reason), (1, "")]


def test_who_dies_in_a_scene_is_not_ranked() -> None:
    lost = {"malformed": 0, "reasons": {"a|0": "crashed: it fell"}}
    sound, cut = write_record(*times(9.0), name="sound"), write_record(*EIGHT, name="cut", missed=lost)
    assert (why_unranked(cut), ranks(sound, cut)) == (f"1 of {cut.runs} scenes and seeds were not finished", [1, None])


@pytest.mark.parametrize(("error", "worse"), [(1.0, False), (1.15, False), (1.17, True), (2.0, True), (None, False)])
def test_a_submission_scores_alike_under_another_motion(error: float | None, worse: bool) -> None:
    assert (worse_when_moved(write_record(1.05), {"all": error}) is not None) is worse


@pytest.mark.parametrize(
    ("subset", "factor", "worse"),
    [("ids", 1.09, False), ("ids", 1.2, True), ("reacquired", 1.2, True), ("frag", 9.0, False)],
)
def test_so_it_does_on_event_subsets_that_rank(subset: Subset, factor: float, worse: bool) -> None:
    record = on_events(write_record(*EIGHT))
    moved = {each: (record.row_of(each).error or 0.0) for each in record.subsets}
    moved[subset] *= factor
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
    (2, [FELL] * 6, ("crashed", f"no scene was finished: {FELL}")),
    (3, [FELL, BROKE], ("rejected", "a|1: it answered before it was asked")),
])  # fmt: skip
def test_status_of_a_record(scenes: int, reasons: list[str], status: tuple[str, str]) -> None:
    runs = [f"{scene}|{seed}" for scene in "abc" for seed in range(3)]
    missed = {"malformed": 0, "reasons": dict(zip(runs, reasons, strict=False))}
    record = write_record(*[1.0] * scenes, env={"scenes_of_split": 3}, missed=missed)
    assert (record.status, record.status_reason) == status


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
