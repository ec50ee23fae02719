"""Records written by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from mtp_bench.gateway import Limits
from mtp_bench.records.record import Record, ScenePart
from mtp_bench.records.storage import sealed
from mtp_bench.scoring import SUBSETS
from mtp_bench.scoring.subsets import Subset

EVENTS = ("lost", "frag")  # subsets that have weight in `scene_part`


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
    return ScenePart(
        scene=name,
        weight={subset: [float(count)] * len(errors) for subset, count in some.items()},
        error={subset: [count * error for error in errors] for subset, count in some.items()},
    )


def make_row(agent: str, subset: str, error: float | None, **changed: Any) -> dict[str, Any]:
    """A row as JSON: ``error`` stands for every error."""
    objects = changed.get("objects", 25)
    return {
        "agent": agent, "hypotheses": 1, "samples": 4, "budget": "equal", "subset": subset, "minADE": error,
        "minFDE": error, "error": error, "interval": None, "localisation": error and 0.7 * error,
        "missed": error and 0.3 * error, "error_by_score": error, "plain_error": error, "fixed_error": None,
        "energy_score": error, "coverage": 1.0, "difference_to_stp": None, "difference_interval": None, "p": None,
        "gap_closed": None, "gap_interval": None, "gap_closed_same_predictor": None,
        "gap_same_predictor_interval": None, "rank": None,
        "unranked_because": None, "targets": 40, "effective_targets": 40.0, "events": None, "objects": objects,
        "effective_objects": float(objects), "scenes": 11, "effective_units": 11.0, "seeds": 3, "ms_per_frame": None,
        **changed,
    }  # fmt: skip


def make_record(
    name: str, rows: Sequence[Mapping[str, Any]], scenes: Sequence[Mapping[str, Any]], **changed: Any
) -> Record:
    """A finished record with its digest; ``changed`` replaces fields, those of a section one by one."""
    keys = {f"{scene['scene']}|{seed}": hex_of(name) for scene in scenes for seed in (0, 1, 2)}
    content: dict[str, Any] = {
        "format": 2,
        "submission": {
            "name": name, "authors": ["A"], "description": "", "digest": hex_of(name), "parameters": {}, "ends": "controls",
            "source": "", "commit": "", "license": "",
        },
        "division": "closed",
        "training_data": [],
        "env": {
            "id": "MTP-Small-v0", "card_digest": "cc" * 8, "split": "val", "data_manifest": "dd" * 32, "scenes": len(scenes),
            "scenes_of_split": len(scenes), "observe": "detections", "truth_complete": True, "keywords": {},
        },
        "scorer": {"definitions": "2.0", "source_digest": "ee" * 32},
        "reference": {"name": "stp", "hash": "ff" * 32, "origin": "frozen event weights", "frozen": True},
        "seeds": [0, 1, 2],
        "status": "finished",
        "status_reason": "",
        "versions": {"numpy": "2.1"},
        "limits": asdict(Limits()),
        "missed": {"late": 0, "malformed": 0, "crashed_scenes": 0, "reasons": {}},
        "isolation": {"mechanism": "bubblewrap", "filtered": True, "memory": "watch", "cuda": False},
        "hypotheses": rows[0]["hypotheses"],
        "samples": rows[0]["samples"],
        "rows": rows,
        "silence": None,
        "details": {},
        "per_scene": scenes,
        "seals": keys,
        "rollout_digests": keys,
        "measured": {
            "hardware": {"cpu": "x", "cores": 2, "memory_gib": 8.0, "gpu": None},
            "latency": {"p50_ms": 1.0, "p95_ms": 2.0, "max_ms": 3.0},
            "ms_per_frame": 1.0, "peak_memory_mib": 100.0, "made": "2030-01-01",
        },
    }  # fmt: skip
    for field, value in changed.items():
        content[field] = merged(content.get(field), value)
    return sealed(Record.model_validate(content))


def write_record(
    *errors: float,
    name: str = "echo",
    objects: int = 40,
    interval: list[float] | None = None,
    budget: str = "equal",
    **changed: Any,
) -> Record:
    """A record on ten targets per scene, one unit each, with these mean errors. ``changed`` replaces fields."""
    scenes = [scene_part(chr(ord("a") + i), 10, error).model_dump() for i, error in enumerate(errors)]
    counts = {"targets": 10 * len(scenes), "scenes": len(scenes), "interval": interval, "budget": budget}
    mean = sum(errors) / len(errors)
    rows = [make_row(name, s, mean, **counts, objects=objects if s == "all" else 5) for s in SUBSETS]
    return make_record(name, rows, scenes, **changed)
