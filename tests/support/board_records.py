"""Records made up for tests of the leaderboard: no submission of these names exists, no number was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mtp_bench.records import Record
from mtp_bench.viz.board import Entry, entries_of
from tests.support.stored_records import hex_of, make_record, make_row, merged

Table = dict[str, Any]

TARGETS = {"all": 350, "ids": 11, "lost": 27, "reacquired": 10, "frag": 36, "paper_ids": 9, "paper_frag": 30}  # a scene
OBJECTS = {"all": 312, "ids": 41, "lost": 96, "reacquired": 17, "frag": 102, "paper_ids": 30, "paper_frag": 90}
HARDER = {"all": 1.0, "ids": 1.55, "lost": 2.4, "reacquired": 1.8, "frag": 2.2, "paper_ids": 1.5, "paper_frag": 2.0}
SCENES = 12

HOSTILE = '</script><img src=x onerror="window.hacked=1">'


def made_up(
    name: str,
    error: float | None = 1.0,
    env_id: str = "MTP-Intersection-v0",
    spread: float = 0.08,
    hypotheses: int = 1,
    scenes: int = SCENES,
    **changed: Any,
) -> Record:
    """A record; ``changed`` replaces fields, those of a nested section one by one.

    The scenes differ by the same factors in all records, and by 5 % more in a pattern of their own: equal errors share
    a rank.
    """
    rows = [_row(name, subset, error, spread, hypotheses, scenes) for subset in TARGETS]
    known: Table = {
        "submission": {
            "authors": ["Ada Fiction", "Ben Example"], "description": "Made up for a picture.",
            "digest": hex_of(f"submission {name}"),
        },
        "env": {
            "id": env_id, "card_digest": hex_of(env_id)[:16], "data_manifest": hex_of(f"data {env_id}"), "scenes": scenes,
            "scenes_of_split": scenes,
        },
        "measured": {
            "latency": {"p50_ms": 1.4 + hypotheses, "p95_ms": 2.9 + 2 * hypotheses, "max_ms": 40.25},
            "peak_memory_mib": 210.0 + 14 * hypotheses,
        },
    }  # fmt: skip
    for field, value in changed.items():
        known[field] = merged(known.get(field), value)
    parts = [] if error is None else _scenes(name, error, scenes)
    return make_record(name, rows, parts, **known)


def _row(name: str, subset: str, error: float | None, spread: float, hypotheses: int, scenes: int) -> Table:
    worse = None if error is None else error * HARDER[subset]
    interval = None if worse is None else [worse * (1 - spread), worse * (1 + 1.2 * spread)]
    counts = {"targets": TARGETS[subset] * scenes, "objects": OBJECTS[subset], "scenes": scenes, "interval": interval}
    events = None if subset == "all" else 1.5 * TARGETS[subset] * scenes
    return make_row(name, subset, worse, hypotheses=hypotheses, samples=20, events=events, **counts)


def _scenes(name: str, error: float, scenes: int) -> list[Table]:
    """Scenes of one unit; the mean over all targets is the error."""
    noise = 0.05 * np.random.default_rng(int(hex_of(name)[:8], 16)).normal(size=scenes)
    factor = np.where(np.arange(scenes) % 4 % 3 == 0, 1.35, 0.65)
    errors = error * (factor / factor.mean() + noise - noise.mean())
    return [
        {
            "scene": f"{i:04d}",
            "weight": {subset: [float(count)] for subset, count in TARGETS.items()},
            "error": {subset: [here * HARDER[subset] * count] for subset, count in TARGETS.items()},
        }
        for i, here in enumerate(errors.tolist())
    ]


def board_of(*records: Record, links: Sequence[str | None] = (), added: str = "") -> list[Entry]:
    """Entries in the order of the leaderboard; the record of the submission ``added`` is not part of it."""
    of_each = links or [None] * len(records)
    return entries_of(
        [(record, link, record.submission.name == added) for record, link in zip(records, of_each, strict=True)]
    )


def made_up_board() -> list[Record]:
    """Records of two environments; the second has too few recordings to rank."""
    pets: Table = {"env_id": "MTP-PETS-v0", "scenes": 4}
    truth = {"observe": "truth"}
    return [
        made_up("braided_paths", 0.742, hypotheses=20),
        made_up("forest_of_maybe", 0.744, hypotheses=10),
        made_up("calm_hedge", 0.823, hypotheses=5, spread=0.05),
        made_up("late_decider", 0.921, hypotheses=8, training_data=["split train of this env"]),
        made_up("stp", 1.068, silence=2.0),
        made_up("straight_on", 1.434, spread=0.1, missed={"late": 14}),
        made_up("truth_past", 0.381, env=truth),
        made_up("pooled_many", 0.655, hypotheses=40, division="open"),
        made_up("short_of_breath", 1.6, status="partial", status_reason="3 of 12 scenes were cut short"),
        made_up("sleeper", None, status="crashed", status_reason="the process ended by signal 9"),
        made_up("braided_paths", 0.411, hypotheses=20, **pets),
        made_up("stp", 0.532, spread=0.2, **pets),
        made_up("calm_hedge", 0.548, hypotheses=5, **pets),
    ]
