"""Records made up for tests of the leaderboard: no submission of these names exists, no number was measured."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from typing import Any

from mtp_bench.records import Record, why_unranked
from mtp_bench.viz.board import Entry, standings
from tests.support.stored_records import make_record, make_row

Table = dict[str, Any]

SUBSETS = {"all": 4210, "ids": 131, "lost": 322, "reacquired": 118, "frag": 440}
OBJECTS = {"all": 312, "ids": 41, "lost": 96, "reacquired": 17, "frag": 102}
HARDER = {"all": 1.0, "ids": 1.55, "lost": 2.4, "reacquired": 1.8, "frag": 2.2}
SCENES = 12
SECRET = {"commitment": "c0ffee", "scenes": 20, "targets": 7000, "missing_aware": 0.83, "interval": [0.78, 0.9]}

HOSTILE = '</script><img src=x onerror="window.hacked=1">'


def made_up(
    name: str,
    error: float | None = 1.0,
    env_id: str = "MTP-Intersection-v0",
    spread: float = 0.08,
    hypotheses: int = 1,
    **changed: Any,
) -> Record:
    """A record; ``changed`` replaces fields, those of a nested section one by one."""
    subsets = [_row(name, subset, error, spread, hypotheses) for subset in SUBSETS]
    known: Table = {
        "submission": {
            "authors": ["Ada Fiction", "Ben Example"], "description": "Made up for a picture.",
            "digest": _hex(f"submission {name}"),
        },
        "env": {
            "id": env_id, "card_digest": _hex(env_id)[:16], "data_manifest": _hex(f"data {env_id}"),
            "scenes": SCENES, "scenes_of_split": SCENES,
        },
        "seeds": [0, 1, 2],
        "latency": {"p50_ms": 1.4 + hypotheses, "p95_ms": 2.9 + 2 * hypotheses, "max_ms": 40.25, "limit_ms": 100.0},
        "peak_memory_mib": 210.0 + 14 * hypotheses,
        "details": {} if error is None else {"parts": _parts(error)},
    }  # fmt: skip
    for field, value in changed.items():
        known[field] = {**known[field], **value} if isinstance(known.get(field), dict) else value
    scenes = [] if error is None else [_scene(i, error) for i in range(SCENES)]
    return make_record(name, subsets, scenes, **known)


def _row(name: str, subset: str, error: float | None, spread: float, hypotheses: int) -> Table:
    worse = None if error is None else error * HARDER[subset] / (1 + 0.03 * hypotheses * (subset != "all"))
    interval = None if worse is None else [worse * (1 - spread), worse * (1 + 1.2 * spread)]
    counts = {"targets": SUBSETS[subset], "objects": OBJECTS[subset], "scenes": SCENES, "interval": interval}
    return make_row(name, subset, worse, hypotheses=hypotheses, samples=20, **counts)


def _scene(i: int, error: float) -> Table:
    here = error * (1.35 if i % 4 in (0, 3) else 0.65)  # their mean over all targets is the error
    counts = {subset: targets // SCENES + i for subset, targets in SUBSETS.items()}
    errors = {subset: [here * HARDER[subset] * count] * 3 for subset, count in counts.items()}
    return {
        "scene": f"{i:04d}", "targets": counts["all"], "missing_aware": here, "seeds": [here] * 3,
        "counts": counts, "errors": errors,
    }  # fmt: skip


def _parts(error: float) -> Table:
    return {"localisation": 0.55 * error, "missed": 0.3 * error, "false": 0.15 * error}


def _hex(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def entries_of(
    records: Sequence[Record],
    ranks: Sequence[int | None],
    reasons: Sequence[str] = (),
    links: Sequence[str | None] = (),
    added: Collection[int] = (),
) -> list[Entry]:
    """Entries in the order of the leaderboard; ``added`` holds places of records that are not part of it."""
    known = reasons or [""] * len(records)
    why = [
        reason or ("" if rank is not None else why_unranked(record) or "")
        for record, rank, reason in zip(records, ranks, known, strict=True)
    ]
    columns = records, ranks, why, links or [None] * len(records)
    return standings([Entry(*cells, added=i in added) for i, cells in enumerate(zip(*columns, strict=True))])


def made_up_board() -> tuple[list[Record], list[int | None], list[str]]:
    """Records of two environments with ranks and reasons."""
    kitti = "MTP-KITTI-v0"
    truth = {"observe": "truth"}
    listed: list[tuple[Record, int | None, str]] = [
        (made_up("braided_paths", 0.742, hypotheses=20, verification="re-run"), 1, ""),
        (made_up("forest_of_maybe", 0.761, hypotheses=10, verification="re-scored"), 1, ""),
        (made_up("calm_hedge", 0.823, hypotheses=5, spread=0.05, verification="hidden seeds", hidden=SECRET), 3, ""),
        (made_up("late_decider", 0.871, hypotheses=8, training_data=["split train of this env"]), 4, ""),
        (made_up("stp", 0.968, verification="re-run"), 5, ""),
        (made_up("straight_on", 1.134, spread=0.1, missed={"late": 14}), 6, ""),
        (made_up("truth_past", 0.381, env=truth), None, "saw the truth"),
        (made_up("pooled_many", 0.655, hypotheses=40, division="open"), 1, ""),
        (made_up("short_of_breath", 1.6, status="partial", status_reason="3 of 12 scenes were cut short"), None, ""),
        (made_up("sleeper", None, status="crashed", status_reason="the process ended by signal 9"), None, ""),
        (made_up("braided_paths", 0.411, kitti, hypotheses=20), 1, ""),
        (made_up("stp", 0.532, kitti, spread=0.2), 2, ""),
        (made_up("calm_hedge", 0.548, kitti, hypotheses=5), 2, ""),
    ]
    records, ranks, reasons = zip(*listed, strict=True)
    return list(records), list(ranks), list(reasons)
