"""What a record says of its runs before there are any: by it a submit knows what an earlier one has done for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..errors import RecordError
from ..gateway import Limits
from ..running.run import library_versions
from ..scoring import DEFINITIONS
from .record import Record
from .running import Plan
from .storage import PARTS, ROLLOUTS, load_record


def stated_before(plan: Plan, limits: Limits, division: str, training_data: Sequence[str]) -> dict[str, Any]:
    """What the record of a plan will say of its runs, as JSON."""
    return {
        "submission": plan.image.digest,
        "env": plan.card.id,
        "card": plan.card.digest,
        "scenes": list(plan.scenes),
        "seeds": list(plan.options.seeds),
        "observe": plan.submission.compare.observe,
        "keywords": plan.stated_keywords,
        "limits": asdict(limits),
        "division": division,
        "training_data": list(training_data),
        "definitions": DEFINITIONS,
        "versions": library_versions(),
    }


def stated_by(record: Record) -> dict[str, Any]:
    """The same of a record that is there."""
    return {
        "submission": record.submission.digest,
        "env": record.env.id,
        "card": record.env.card_digest,
        "scenes": [part.scene for part in record.per_scene],
        "seeds": record.seeds,
        "observe": record.env.observe,
        "keywords": record.env.keywords,
        "limits": record.limits.model_dump(),
        "division": record.division,
        "training_data": record.training_data,
        "definitions": record.scorer.definitions,
        "versions": record.versions,
    }


def finished_record(target: Path, stated: Mapping[str, Any], rollouts: bool = True) -> Record | None:
    """The record at ``target`` where it is the whole of what would be run, and nothing of it is left to do.

    ``rollouts``: they must lie beside it.
    """
    if target.with_suffix(PARTS).exists() or (rollouts and not target.with_suffix(ROLLOUTS).is_dir()):
        return None
    try:
        record = load_record(target)
    except RecordError:
        return None
    return record if stated_by(record) == stated else None
