"""Records written by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mtp_bench.records.record import Record, ScenePart
from mtp_bench.records.storage import sealed
from mtp_bench.scoring import SUBSETS


def scene_part(name: str, targets: int, errors: Sequence[float]) -> ScenePart:
    """A scene with these mean errors, one per seed."""
    sums = [targets * error for error in errors]
    return ScenePart(
        scene=name,
        targets=targets,
        missing_aware=sum(errors) / len(errors) if targets else None,
        seeds=[error if targets else None for error in errors],
        counts={"all": targets, "ids": 0, "lost": 2, "reacquired": 0, "frag": 2},
        errors={subset: [2 * e for e in errors] if subset in ("lost", "frag") else sums for subset in SUBSETS},
    )


def make_row(agent: str, subset: str, error: float | None, **changed: Any) -> dict[str, Any]:
    """A row as JSON: ``error`` stands for every error."""
    return {
        "agent": agent, "hypotheses": 1, "samples": 4, "budget": "equal", "subset": subset, "minADE": error,
        "minFDE": error, "missing_aware": error, "energy_score": error, "coverage": 1.0, "gap_closed": None,
        "targets": 40, "events": None, "objects": 25, "scenes": 11, "interval": None, "ms_per_frame": 1.0, **changed,
    }  # fmt: skip


def make_record(
    name: str, rows: Sequence[Mapping[str, Any]], scenes: Sequence[Mapping[str, Any]], **changed: Any
) -> Record:
    """A finished record with its digest; ``changed`` replaces fields, those of a section one by one."""
    content: dict[str, Any] = {
        "format": 1,
        "submission": {"name": name, "authors": ["A"], "description": "", "digest": "aa", "parameters": {}},
        "division": "closed",
        "training_data": [],
        "env": {
            "id": "MTP-Small-v0", "card_digest": "cc", "split": "val", "data_manifest": "dd", "scenes": len(scenes),
            "scenes_of_split": len(scenes), "observe": "detections", "truth_complete": True, "keywords": {},
        },
        "scorer": {"definitions": "1.0", "source_digest": "ee"},
        "reference": {"name": "stp", "hash": "ff", "origin": "frozen"},
        "seeds": [0],
        "status": "finished",
        "status_reason": "",
        "verification": "scored",
        "versions": {"numpy": "2.1"},
        "hardware": {"cpu": "x", "cores": 2, "memory_gib": 8.0, "gpu": None},
        "latency": {"p50_ms": 1.0, "p95_ms": 2.0, "max_ms": 3.0, "limit_ms": 5000.0},
        "peak_memory_mib": 100.0,
        "missed": {"late": 0, "malformed": 0, "crashed_scenes": 0, "reasons": {}},
        "isolation": {"network_cut": True, "files_hidden": True},
        "hypotheses": rows[0]["hypotheses"],
        "samples": rows[0]["samples"],
        "rows": rows,
        "details": {},
        "per_scene": scenes,
        "seals": {},
        "rollout_digests": {},
        "made": "2030-01-01",
    }  # fmt: skip
    for field, value in changed.items():
        section = content.get(field)
        content[field] = {**section, **value} if isinstance(section, dict) and value is not None else value
    return sealed(Record.model_validate(content))


def write_record(
    errors: Mapping[str, Sequence[float]],
    name: str = "echo",
    objects: int = 40,
    interval: list[float] | None = None,
    budget: str = "equal",
    **changed: Any,
) -> Record:
    """A record on ten targets per scene; ``errors``: scene -> mean error per seed. ``changed`` replaces fields."""
    scenes = [scene_part(scene, 10, values) for scene, values in errors.items()]
    mean = sum(part.missing_aware or 0.0 for part in scenes) / len(scenes)
    counts = {"targets": 10 * len(scenes), "scenes": len(scenes), "interval": interval, "budget": budget}
    rows = [make_row(name, s, mean, **counts, objects=objects if s == "all" else 5) for s in SUBSETS]
    known = {"seeds": list(range(len(next(iter(errors.values()))))), "details": {"forecasts_per_frame": 3.0}}
    return make_record(name, rows, [part.model_dump() for part in scenes], **{**known, **changed})
