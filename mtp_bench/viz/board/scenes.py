"""The errors of the scenes of one entry, as bars on a common scale."""

from __future__ import annotations

from dataclasses import dataclass

from .entries import Entry, finite

BAR = 120.0  # width of the longest bar, user units


@dataclass(frozen=True)
class SceneBar:
    """One scene of an entry."""

    scene: str
    targets: int | None
    error: float | None  # m
    width: float  # of its bar, user units
    reference: float | None  # where the reference's error in this scene is marked


def scene_chart(entry: Entry, reference: Entry | None) -> list[SceneBar]:
    """Bars of the scenes, in the order of the record; those of ``reference`` where it has the same scenes."""
    beside = {} if reference is None or reference is entry else _errors(reference)
    own = _errors(entry)
    most = max([*own.values(), *(beside[name] for name in own if name in beside)], default=0.0)
    unit = BAR / most if most > 0 else 0.0
    return [
        SceneBar(
            scene=str(row.get("scene")),
            targets=None if (count := finite(row.get("targets"))) is None else int(count),
            error=finite(row.get("missing_aware")),
            width=round(unit * (finite(row.get("missing_aware")) or 0.0), 1),
            reference=round(unit * beside[str(row.get("scene"))], 1) if str(row.get("scene")) in beside else None,
        )
        for row in entry.record.get("per_scene") or ()
    ]


def _errors(entry: Entry) -> dict[str, float]:
    rows = entry.record.get("per_scene") or ()
    return {str(row.get("scene")): error for row in rows if (error := finite(row.get("missing_aware"))) is not None}
