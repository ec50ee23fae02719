"""Records written by hand: other fields follow from the sums of their scenes."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

from mtp_bench.judge import Limits
from mtp_bench.judge.records.attestation import Checked, SignedLevel, Statement
from mtp_bench.judge.records.evaluation import scorer_digest
from mtp_bench.judge.records.fields import Level
from mtp_bench.judge.records.ranking import Standing, standings
from mtp_bench.judge.records.record import HiddenPart, Record
from mtp_bench.judge.records.seal import ListedSeal
from mtp_bench.judge.records.shipped import Shipped, baseline_digest, shipped
from mtp_bench.judge.records.storage import record_text, with_digests
from mtp_bench.judge.records.targets import UnitTargets
from mtp_bench.scoring import DEFINITIONS, SUBSETS
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.statistics import ratio
from mtp_bench.scoring.weights import scene_key

EVENTS = ("lost", "frag")  # subsets that have weight in `scene_part`
SIMULATED = "MTP-Merge-v0"
Ships = Callable[[str], Shipped | None]  # the shipped env of an id


def hex_of(text: str) -> str:
    """A digest for something that is made up."""
    return hashlib.sha256(text.encode()).hexdigest()


def merged(section: Any, changed: Any) -> Any:
    """A section with changes, those of its own sections one by one; anything else is replaced."""
    if not isinstance(section, dict) or not isinstance(changed, dict):
        return changed
    return {**section, **{name: merged(section.get(name), value) for name, value in changed.items()}}


def scene_part(name: str, targets: int, *errors: float) -> dict[str, Any]:
    """Sums of a scene whose units have as many ``targets`` each and these mean errors."""
    some: dict[Subset, int] = {subset: 2 * (subset in EVENTS) for subset in SUBSETS}
    some["all"] = targets
    weight = {subset: [float(count)] * len(errors) for subset, count in some.items()}
    error = {subset: [count * error for error in errors] for subset, count in some.items()}
    return {"scene": name, "weight": weight, "error": error}


def make_targets(
    scenes: Sequence[Mapping[str, Any]], objects: Mapping[Any, int], nothing_predicted: float | None = None
) -> UnitTargets:
    """The targets of scenes (`scene_part`), which are of these numbers of ``objects`` per subset."""
    subsets = {}
    for subset in objects:
        weight = [value for scene in scenes for value in scene["weight"][subset]]
        targets = round(sum(weight) + 0.499)
        count = min(objects[subset], targets)
        subsets[subset] = {
            "weight": weight, "targets": targets, "effective_targets": sum(weight), "objects": count,
            "effective_objects": float(count), "events": None,
            "scenes": sum(sum(scene["weight"][subset]) > 0 for scene in scenes),
        }  # fmt: skip
    return UnitTargets.model_validate({
        "scenes": [scene["scene"] for scene in scenes],
        "scene_units": [len(scene["weight"]["all"]) for scene in scenes],
        "nothing_predicted": nothing_predicted, "subsets": subsets,
    })  # fmt: skip


def make_results(scenes: Sequence[Mapping[str, Any]], subsets: Sequence[Subset] = SUBSETS) -> dict[str, Any]:
    """Errors of scenes (`scene_part`), and numbers that fit them."""
    errors = {subset: [value for scene in scenes for value in scene["error"][subset]] for subset in subsets}
    numbers: dict[Subset, dict[str, float]] = {}
    for subset in subsets:
        weight = sum(value for scene in scenes for value in scene["weight"][subset])
        mean = ratio(sum(errors[subset]), weight)
        same = ("minADE", "minFDE", "error_by_score", "plain_error", "energy_score")
        of_error = {} if mean is None else {**dict.fromkeys(same, mean), "missed": 0.3 * mean}
        numbers[subset] = {**of_error, "coverage": 1.0}
    return {"error": errors, "numbers": numbers}


def make_record(
    name: str,
    scenes: Sequence[Mapping[str, Any]],
    objects: int | Mapping[Any, int] = 25,
    nothing_predicted: float | None = None,
    **changed: Any,
) -> Record:
    """A finished record with its digest; ``changed`` replaces fields, those of a section one by one.

    ``scenes``: sums (`scene_part`); ``objects``: number of those with targets, by subset.
    """
    by_subset = dict.fromkeys(SUBSETS, objects) if isinstance(objects, int) else objects
    targets = make_targets(scenes, by_subset, nothing_predicted)
    content: dict[str, Any] = {
        "format": 3,
        "submission": {
            "name": name, "authors": ["A"], "description": "", "digest": baseline_digest(name) or hex_of(name),
            "parameters": {}, "gap_references": "controls", "networks": {}, "source": "", "commit": "", "paper": "",
            "license": "",
        },
        "training_data": [],
        "env": {
            "id": "MTP-Small-v0", "card_digest": "cc" * 8, "split": "val", "data_manifest": "dd" * 32,
            "scenes_of_split": len(scenes), "observe": "detections", "truth_complete": True, "keywords": {},
        },
        "scorer": {"definitions": DEFINITIONS, "source_digest": scorer_digest()},
        "reference": {"name": "stp", "hash": "ff" * 32, "origin": "frozen event weights", "frozen": True},
        "seeds": [0, 1, 2],
        "versions": {"numpy": "2.1"},
        "limits": Limits().model_dump(),
        "missed": {"malformed": 0, "reasons": {}},
        "isolation": {"mechanism": "bubblewrap", "memory": "watch"},
        "hypotheses": 1,
        "samples": 4,
        **make_results(scenes, list(by_subset)),
        "measured": {
            "hardware": {"cpu": "x", "cores": 2, "memory_gib": 8.0},
            "latency": {"p50_ms": 1.0, "p95_ms": 2.0, "max_ms": 3.0},
            "ms_per_frame": 1.0, "peak_memory_mib": 100.0, "made": "2026-01-01",
        },
    }  # fmt: skip
    content = merged(content, changed)
    content.setdefault("hashes", {"seals": hex_of(name), "rollouts": hex_of(name)})
    content.setdefault("targets", targets.model_dump())
    content.setdefault("targets_sha256", targets.digest)
    return with_digests(Record.model_validate(content))


def save_record(record: Record, path: Path) -> Record:
    record, text = record_text(record, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return record


def _scenes(errors: Sequence[float]) -> list[dict[str, Any]]:
    names = [*"abcdefghijklmnopqrstuvwxyz", *(f"z{i}" for i in range(len(errors)))]
    return [scene_part(scene, 10, error) for scene, error in zip(names, errors, strict=False)]


def _objects(of_all: int) -> dict[Subset, int]:
    return {subset: of_all if subset == "all" else 5 for subset in SUBSETS}


def write_record(*errors: float, name: str = "echo", objects: int = 40, **changed: Any) -> Record:
    """A record on ten targets per scene, one unit each, with these mean errors. ``changed`` replaces fields."""
    scenes = changed.pop("scenes", None) or _scenes(errors)
    return make_record(name, scenes, _objects(objects), **changed)


def ships_of(*records: Record, simulated: bool = False) -> Ships:
    """As if the cards and event weights of these records shipped: of each env those of the first."""
    known: dict[str, Shipped] = {}
    for record in records:
        sums = {subset: record.targets.scene_sums(record.unit_weight(subset)).tolist() for subset in SUBSETS}
        by_scene: dict[str, dict[Subset, float]] = {
            scene_key(record.env.id, scene): {subset: sums[subset][i] for subset in SUBSETS}
            for i, scene in enumerate(record.scenes)
        }
        of_card = record.env.card_digest, simulated, record.samples
        known.setdefault(record.env.id, Shipped(*of_card, float("inf"), record.reference.hash, by_scene))
    return known.get


def as_if_shipped(ships: Ships) -> Any:
    """As if these environments shipped, while the block lasts."""
    return mock.patch("mtp_bench.judge.records.eligibility.shipped", ships)


def standings_of(
    records: Sequence[Record], levels: Mapping[str, SignedLevel] | None = None, ships: Ships = shipped
) -> dict[str, Standing]:
    """The standings of records with these levels by digest, as if the environments of ``ships`` shipped."""
    with as_if_shipped(ships):
        return standings([Checked(record, (levels or {}).get(record.digest)) for record in records])


def hidden_part(*errors: float, seal: str = "first", **changed: Any) -> HiddenPart:
    """The scores on as many hidden scenes as there are ``errors``, of one unit each."""
    scenes = _scenes(errors)
    targets = make_targets(scenes, _objects(40)).model_dump() | {"scenes": [], "scene_units": []}
    content = {
        "commitment": hex_of(seal), "weights": hex_of(f"weights {seal}"), "scenes": len(scenes),
        "targets": targets, **make_results(scenes),
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
