"""Records written by hand: other fields follow from the sums of their scenes."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mtp_bench.judge import Limits
from mtp_bench.judge.records.attestation import Level, SignedLevel, Statement
from mtp_bench.judge.records.eligibility import Ships
from mtp_bench.judge.records.evaluation import scorer_digest, status_of
from mtp_bench.judge.records.record import HiddenPart, MissedPart, Record, ScenePart
from mtp_bench.judge.records.seal import ListedSeal
from mtp_bench.judge.records.shipped import Shipped, baseline_digest
from mtp_bench.judge.records.storage import record_text, sealed
from mtp_bench.scoring import DEFINITIONS, SUBSETS
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.statistics import bootstrap_interval, effective_number, ratio
from mtp_bench.scoring.weights import scene_key
from tests.support.report_rows import row_content

EVENTS = ("lost", "frag")  # subsets that have weight in `scene_part`
SIMULATED = "MTP-Merge-v0"


def hex_of(text: str) -> str:
    """A digest for something that is made up."""
    return hashlib.sha256(text.encode()).hexdigest()


def merged(section: Any, changed: Any) -> Any:
    """A section with changes, those of its own sections one by one; anything else is replaced."""
    if not isinstance(section, dict) or not isinstance(changed, dict):
        return changed
    return {**section, **{name: merged(section.get(name), value) for name, value in changed.items()}}


def scene_part(name: str, targets: int, *errors: float) -> ScenePart:
    """A scene whose units have as many ``targets`` each and these mean errors."""
    some: dict[Subset, int] = {subset: 2 * (subset in EVENTS) for subset in SUBSETS}
    some["all"] = targets
    weight = {subset: [float(count)] * len(errors) for subset, count in some.items()}
    error = {subset: [count * error for error in errors] for subset, count in some.items()}
    return ScenePart(scene=name, weight=weight, error=error)


def make_row(agent: str, subset: Subset, scenes: Sequence[Mapping[str, Any]], **changed: Any) -> dict[str, Any]:
    """A row as JSON that follows from the sums of ``scenes``, each of its errors the same."""
    weight = [value for scene in scenes for value in scene["weight"][subset]]
    errors = [value for scene in scenes for value in scene["error"][subset]]
    total, objects = sum(weight), changed.pop("objects", 25)
    targets = round(total + 0.499)
    error, interval = ratio(sum(errors), total), bootstrap_interval(errors, weight) if weight else None
    content = row_content(
        agent=agent, hypotheses=1, samples=4, budget="equal", subset=subset, interval=interval and list(interval),
        localisation=error and 0.7 * error, missed=error and 0.3 * error, coverage=1.0, targets=targets,
        effective_targets=total, objects=min(objects, targets), effective_objects=float(min(objects, targets)),
        scenes=sum(sum(scene["weight"][subset]) > 0 for scene in scenes), effective_units=effective_number(weight),
        seeds=3,
    )  # fmt: skip
    same = ("minADE", "minFDE", "error", "error_by_score", "plain_error", "energy_score")
    return {**content, **dict.fromkeys(same, error), **changed}


def make_record(
    name: str, rows: Sequence[Mapping[str, Any]], scenes: Sequence[Mapping[str, Any]], **changed: Any
) -> Record:
    """A finished record with its digest; ``changed`` replaces fields, those of a section one by one."""
    content: dict[str, Any] = {
        "format": 2,
        "submission": {
            "name": name, "authors": ["A"], "description": "", "digest": baseline_digest(name) or hex_of(name),
            "parameters": {}, "gap_references": "controls", "networks": {}, "source": "", "commit": "", "paper": "",
            "license": "",
        },
        "division": "closed",
        "training_data": [],
        "env": {
            "id": "MTP-Small-v0", "card_digest": "cc" * 8, "split": "val", "data_manifest": "dd" * 32,
            "scenes": len(scenes), "scenes_of_split": len(scenes), "observe": "detections", "truth_complete": True,
            "keywords": {},
        },
        "scorer": {"definitions": DEFINITIONS, "source_digest": scorer_digest()},
        "reference": {"name": "stp", "hash": "ff" * 32, "origin": "frozen event weights", "frozen": True},
        "seeds": [0, 1, 2],
        "status_reason": "",
        "versions": {"numpy": "2.1"},
        "limits": asdict(Limits()),
        "missed": {"late": 0, "malformed": 0, "crashed_scenes": 0, "reasons": {}},
        "isolation": {"mechanism": "bubblewrap", "memory": "watch"},
        "hypotheses": rows[0]["hypotheses"],
        "samples": rows[0]["samples"],
        "rows": rows,
        "nothing_predicted": None,
        "details": {},
        "per_scene": scenes,
        "measured": {
            "hardware": {"cpu": "x", "cores": 2, "memory_gib": 8.0, "gpu": None},
            "latency": {"p50_ms": 1.0, "p95_ms": 2.0, "max_ms": 3.0},
            "ms_per_frame": 1.0, "peak_memory_mib": 100.0, "made": "2026-01-01",
        },
    }  # fmt: skip
    content = merged(content, changed)
    content.setdefault("hashes", {"seals": hex_of(name), "rollouts": hex_of(name)})
    env, missed = content["env"], MissedPart.model_validate(content["missed"])
    runs = len(content["per_scene"]) * len(content["seeds"])
    content.setdefault("status", status_of(env["scenes"], env["scenes_of_split"], missed, runs)[0])
    return sealed(Record.model_validate(content))


def save_record(record: Record, path: Path) -> Record:
    record, text = record_text(record, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return record


def _scenes(errors: Sequence[float]) -> list[dict[str, Any]]:
    names = [*"abcdefghijklmnopqrstuvwxyz", *(f"z{i}" for i in range(len(errors)))]
    return [scene_part(scene, 10, error).model_dump() for scene, error in zip(names, errors, strict=False)]


def _rows(name: str, scenes: list[dict[str, Any]], objects: int = 40, **changed: Any) -> list[dict[str, Any]]:
    counts = {subset: objects if subset == "all" else 5 for subset in SUBSETS}
    return [make_row(name, subset, scenes, objects=count, **changed) for subset, count in counts.items()]


def write_record(
    *errors: float, name: str = "echo", objects: int = 40, budget: str = "equal", **changed: Any
) -> Record:
    """A record on ten targets per scene, one unit each, with these mean errors. ``changed`` replaces fields."""
    scenes = changed.pop("per_scene", None) or _scenes(errors)
    return make_record(name, _rows(name, scenes, objects, budget=budget), scenes, **changed)


def ships_of(*records: Record, simulated: bool = False) -> Ships:
    """As if the cards and event weights of these records shipped: of each env those of the first."""
    known: dict[str, Shipped] = {}
    for record in records:
        sums: dict[str, dict[Subset, float]] = {
            scene_key(record.env.id, scene.scene): {subset: sum(scene.weight[subset]) for subset in SUBSETS}
            for scene in record.per_scene
        }
        of_card = record.env.card_digest, simulated, record.samples
        known.setdefault(record.env.id, Shipped(*of_card, float("inf"), record.reference.hash, sums))
    return known.get


def hidden_part(*errors: float, name: str = "echo", seal: str = "first", **changed: Any) -> HiddenPart:
    """The scores on as many hidden scenes as there are ``errors``, of one unit each."""
    scenes = _scenes(errors)
    sums = {
        part: {subset: [value for scene in scenes for value in scene[part][subset]] for subset in SUBSETS}
        for part in ("weight", "error")
    }
    content = {
        "commitment": hex_of(seal), "weights": hex_of(f"weights {seal}"), "scenes": len(scenes),
        "rows": _rows(name, scenes), "nothing_predicted": None, **sums,
    }  # fmt: skip
    return HiddenPart.model_validate(content | changed)


def signed_level(
    record: Record, level: Level = "re-run", hidden: HiddenPart | None = None, made: str = "2030-01-01",
    retired: str = "",
) -> SignedLevel:  # fmt: skip
    """A level of a record, as it is once its signature was checked."""
    digests = {"record": record.digest, "measured": record.measured.digest}
    content = {"level": level, "isolation": "bubblewrap", "date": "2030-02-02", "hidden": hidden, **digests}
    statement = Statement.model_validate(content)
    seal = None if hidden is None else ListedSeal(
        env=record.env.id, card_digest=record.env.card_digest, count=hidden.scenes, commitment=hidden.commitment,
        made=made, name="first", retired=retired,
    )  # fmt: skip
    return SignedLevel(statement, "tester", seal)
