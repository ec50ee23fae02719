"""The moments of a stored run that cost most, the parts of its error, and its doubts."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..core import NO_PROGRESS, Progress
from ..doubts import Doubt
from ..running import OpenedRun
from ..scoring import PARTS, named_parts
from .moment_list import costs, moments
from .played import replays
from .terminal.event_table import Listed
from .terminal.worst_table import WorstRow


@dataclass(frozen=True)
class WorstMoments:
    """Moments of a run by falling cost."""

    rows: list[WorstRow]
    parts: Mapping[str, float]  # m, of the mean error of all targets
    cost: float  # m, of all targets, that moments have shares of
    collisions: list[Listed]
    doubts: list[Doubt]
    unsplit: str  # why the errors of forecasts are not split


def worst_moments(
    opened: OpenedRun,
    scene: str | None = None,
    *,
    is_below: bool = False,
    no_doctor: bool = False,
    progress: Progress = NO_PROGRESS,
) -> WorstMoments:
    """Find the moments of all scenes of a run, or of one ``scene``.

    ``is_below``: their cost is the part below threshold. ``no_doctor``: the data is not
    examined.
    """
    rows = list[WorstRow]()
    collisions = list[Listed]()
    doubts = list[Doubt]()
    part_sum = np.zeros(len(PARTS))
    targets = 0
    unsplit = ""
    place = (str(opened.folder), opened.data)
    for played in replays(opened, scene, progress, no_doctor):
        part_sum += np.nansum(played.part, axis=0)
        targets += int(np.isfinite(played.part[:, 0]).sum())
        unsplit = played.unsplit
        doubts += played.doubts
        for event in played.events:
            if event.kind == "collision":
                collisions.append(Listed.of(played, event, *place))
        for moment in moments(played, is_below):
            rows.append(WorstRow.of(played, moment.at, *place, moment=moment))
    return WorstMoments(
        rows=sorted(rows, key=lambda row: -row.moment.cost),
        parts=named_parts(part_sum / max(1, targets)),
        cost=float(costs(part_sum, is_below)),
        collisions=collisions,
        doubts=doubts,
        unsplit=unsplit,
    )
