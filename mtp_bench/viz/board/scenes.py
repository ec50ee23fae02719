"""The errors of the scenes of one entry, as bars on a common scale."""

from __future__ import annotations

from dataclasses import dataclass

from .entries import Entry

BAR = 120.0  # width of the longest bar, user units


@dataclass(frozen=True)
class SceneBar:
    """One scene of an entry."""

    scene: str
    targets: int
    error: float | None  # m
    width: float  # of its bar, user units
    reference: float | None  # where the reference's error in this scene is marked


def scene_chart(entry: Entry, reference: Entry | None) -> list[SceneBar]:
    """Bars of the scenes, in the order of the record; those of ``reference`` where it has the same scenes."""
    beside = {} if reference is None or reference is entry else _errors(reference)
    errors = _errors(entry)
    most = max([*errors.values(), *(beside[name] for name in errors if name in beside)], default=0.0)
    unit = BAR / most if most > 0 else 0.0
    return [
        SceneBar(
            scene=part.scene,
            targets=part.targets,
            error=part.missing_aware,
            width=round(unit * (part.missing_aware or 0.0), 1),
            reference=round(unit * beside[part.scene], 1) if part.scene in beside else None,
        )
        for part in entry.record.per_scene
    ]


def _errors(entry: Entry) -> dict[str, float]:
    return {part.scene: part.missing_aware for part in entry.record.per_scene if part.missing_aware is not None}
