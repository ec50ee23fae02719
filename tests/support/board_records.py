"""Made-up records, with the cards, scenes and weights of targets that ship: others are not ranked."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench.judge import Record, load_record
from mtp_bench.judge.records.fields import Level
from mtp_bench.judge.records.shipped import shipped
from mtp_bench.scoring.definitions import KNOWN_SUBSETS, SUBSETS, Subset
from mtp_bench.scoring.weights import scene_key
from mtp_bench.viz.board.entries import Entry, LinkedRecord, entries_of
from tests.support.stored_records import SIMULATED, hex_of, make_record, merged, signed_level

Table = dict[str, Any]

MAIN, FEW = "MTP-WILDTRACK-k10-v0", "MTP-WILDTRACK-v0"  # with enough units to rank, and not
# of a scene of an env that does not ship
TARGETS: dict[Subset, float] = dict(zip(KNOWN_SUBSETS, (580, 8, 18, 15, 34, 13, 23, 60), strict=True))
OBJECTS = dict(zip(KNOWN_SUBSETS, (312, 41, 96, 17, 102, 30, 90, 44), strict=True))
HARDER = dict(zip(KNOWN_SUBSETS, (1.0, 1.55, 2.1, 1.8, 2.0, 1.5, 2.0, 1.4), strict=True))
SCENES = 10
NOTHING = 2.0  # m, error if nothing is predicted
UNITS = {FEW: 1}  # of a scene
MOST_UNITS = 4

HOSTILE = '</script><img src=x onerror="window.hacked=1">'
_KNOWN = Path(__file__).parents[2] / "leaderboard" / "records" / "stp"


def made_up(
    name: str, error: float = 1.0, env_id: str = MAIN, spread: float = 0.1, hypotheses: int = 1,
    scenes: int | None = None, subsets: Sequence[Subset] = SUBSETS, **changed: Any,
) -> Record:  # fmt: skip
    """A record; ``changed`` replaces fields, those of a nested section one by one.

    The units differ by the same factors in all records, by ``spread``, and by 5 % more in a pattern of their own: equal
    errors share a rank. ``scenes``: only the first of them.
    ``subsets``: those of old records, or with targets that turn.
    """
    known, every = shipped(env_id), _weights(env_id)
    weights = dict(list(every.items())[:scenes])
    parts = _scenes(name, error, weights, spread, UNITS.get(env_id, MOST_UNITS), subsets)
    content: Table = {
        "submission": {"authors": ["Ada Fiction", "Ben Example"], "description": "Made up for a picture."},
        "env": {
            "id": env_id, "card_digest": hex_of(env_id)[:16] if known is None else known.card,
            "data_manifest": hex_of(f"data {env_id}"), "scenes_of_split": len(every),
        },
        "reference": {} if known is None else {"hash": known.weights},
        "measured": {
            "latency": {"p50_ms": 1.4 + hypotheses, "p95_ms": 2.9 + 2 * hypotheses, "max_ms": 40.25},
            "peak_memory_mib": 210.0 + 14 * hypotheses,
        },
        "hypotheses": hypotheses,
        "samples": known.samples if known else 20,
    }  # fmt: skip
    objects = {subset: OBJECTS[subset] for subset in subsets}
    return make_record(name, parts, objects, NOTHING, **merged(content, changed))


@cache
def _weights(env_id: str) -> Mapping[str, Mapping[Subset, float]]:
    """Scenes of an env with the weight of their targets: those that ship, else some."""
    known, record = shipped(env_id), _KNOWN / f"{env_id}.json"
    if known is None:
        return {f"{i:04d}": TARGETS for i in range(SCENES)}
    if record.is_file() and env_id != SIMULATED:
        names = load_record(record).scenes
    else:
        names = [f"{env_id.split('-')[1].lower()}-{seed:06d}" for seed in range(10_000, 10_000 + len(known.sums))]
    return {name: dict(known.sums[scene_key(env_id, name)]) for name in names}


def _scenes(
    name: str,
    error: float,
    weights: Mapping[str, Mapping[Subset, float]],
    spread: float,
    units: int,
    subsets: Sequence[Subset],
) -> list[Table]:
    """Scenes of equal units; the mean over all targets is the error."""
    count = units * len(weights)
    noise = 0.05 * np.random.default_rng(int(hex_of(name)[:8], 16)).normal(size=count)
    factor = np.where(np.arange(count) % 4 % 3 == 0, 1 + spread, 1 - spread)
    each = np.repeat([targets["all"] for targets in weights.values()], units)
    errors = error * (factor / np.average(factor, weights=each) + noise - np.average(noise, weights=each))
    found = []
    for (scene, targets), here in zip(weights.items(), errors.reshape(-1, units).tolist(), strict=True):
        weight = {subset: [targets.get(subset, 1.0) / units] * units for subset in subsets}
        sums = {subset: [each * HARDER[subset] * weight[subset][0] for each in here] for subset in subsets}
        found.append({"scene": scene, "weight": weight, "error": sums})
    return found


def board_of(
    *records: Record, links: Sequence[str | None] = (), added: str = "", levels: Mapping[str, Level] | None = None
) -> list[Entry]:
    """Entries in the order of the leaderboard; the record of the submission ``added`` is not part of it.

    ``levels``: how far the records of some submissions were checked.
    """
    found = []
    for record, link in zip(records, links or [None] * len(records), strict=True):
        name = record.submission.name
        level = (levels or {}).get(name)
        found.append(LinkedRecord(record, signed_level(record, level) if level else None, link, name == added))
    return entries_of(found)


def all_crashed(reason: str) -> dict[str, str]:
    """Reasons why no scene of `MAIN` was finished."""
    return {f"{scene}|{seed}": f"crashed: {reason}" for scene in _weights(MAIN) for seed in range(3)}


LEVELS_OF: dict[str, Level] = {"braided_paths": "re-run", "forest_of_maybe": "re-scored", "stp": "re-run"}


def made_up_board() -> list[Record]:
    """Records of two environments; the second has too few recordings to rank."""
    few: Table = {"env_id": FEW}
    truth = {"observe": "truth"}
    return [
        made_up("braided_paths", 0.742, hypotheses=20), made_up("forest_of_maybe", 0.744, hypotheses=10),
        made_up("calm_hedge", 0.823, hypotheses=5),
        made_up("late_decider", 0.921, hypotheses=8, training_data=["split train of this env"]),
        made_up("stp", 1.068),
        made_up("straight_on", 1.434, spread=0.1, missed={"malformed": 14}),
        made_up("gt_tracks", 0.381, env=truth),
        made_up("pooled_many", 0.655, hypotheses=40, env={"data_manifest": "ee" * 32}),
        made_up("short_of_breath", 1.5, scenes=3, spread=0.05),
        made_up("sleeper", 4.0, missed={"reasons": all_crashed("the process ended by signal 9")}),
        made_up("braided_paths", 0.411, hypotheses=20, **few), made_up("stp", 0.532, **few),
        made_up("calm_hedge", 0.548, hypotheses=5, **few),
    ]  # fmt: skip
