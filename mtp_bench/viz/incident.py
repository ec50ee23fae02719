"""Incidents of a run: events of the best hypothesis, runs of false forecasts, and moments without either."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ..scoring import BELOW

INCIDENT_KINDS = (
    "ids",
    "lost",
    "reacquired",
    "spurious",
    "collision",
)  # spurious: false forecasts; collision: of the ego
MOMENT = "moment"  # kind of the incident of an object in a frame without an event


@dataclass(frozen=True)
class Incident:
    """One event of the best hypothesis along its lineage, a run of false forecasts of one track, or a moment."""

    kind: str  # of INCIDENT_KINDS, or MOMENT
    frame: int
    until: int  # last frame: that of the event itself, but of a run its end
    row: int  # of the truth; of a run: of its first forecast object
    class_id: int
    position: tuple[
        float, float, float
    ]  # m, of the true box or of the first false forecast, frame of the scene
    name: str = ""  # kind and number within the scene, in the order of frames: "ids-0"; of a moment "car_turn@17"
    object_id: int = -1  # -1 for a run
    old_id: int = (
        -1
    )  # track that matched the object last, before this frame; -1 without one
    new_id: int = (
        -1
    )  # track that matches it now; of a run its own track; -1 without one
    wrong: bool = False  # a loss whose old track is still output, but outside the gate
    minADE: float | None = None  # noqa: N815  (m, of the target's forecast then; None: not a target, or not covered)
    parts: Mapping[str, float] | None = (
        None  # m, by name, those of the target's error; None: not a target
    )
    error_before: float | None = None  # m, error of the object a frame before
    confidence: float | None = (
        None  # of the object's forecast then; of a run the highest; None: no forecast
    )
    first: int = -1  # of a moment that lasts: its first frame; -1: ``frame``

    @property
    def error(self) -> float | None:
        """Sum of the parts, m: the target's bADE, or its plain error where the run was not scored as a whole."""
        return None if self.parts is None else sum(self.parts.values())

    @property
    def blame(self) -> float:
        """The error without the part below threshold, m; 0 if it is not a target."""
        return sum(value for name, value in (self.parts or {}).items() if name != BELOW)

    @property
    def label(self) -> str:
        """The event in as few words as a marker has room for."""
        ids = [
            str(track_id)
            for track_id in dict.fromkeys((self.old_id, self.new_id))
            if track_id >= 0
        ]
        words = {"reacquired": "again", "spurious": "false forecast"}.get(
            self.kind, self.kind
        )
        return f"{words} {' > '.join(ids)}".strip()


def named(incidents: Iterable[Incident]) -> tuple[Incident, ...]:
    """The incidents in the order of frames, kinds and rows, each with its name."""
    count: Counter[str] = Counter()
    named = []
    for incident in sorted(
        incidents, key=lambda i: (i.frame, INCIDENT_KINDS.index(i.kind), i.row)
    ):
        named.append(replace(incident, name=f"{incident.kind}-{count[incident.kind]}"))
        count[incident.kind] += 1
    return tuple(named)
