"""Incidents of a run: events of the best hypothesis, false forecasts, and moments."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ..scoring import BELOW_THRESHOLD, EVENT_KINDS

# spurious: false forecasts; collision: of the ego
INCIDENT_KINDS = (*EVENT_KINDS, "spurious", "collision")
MOMENT = "moment"  # kind of the incident of an object in a frame without an event
_LABELS = {"reacquired": "again", "spurious": "false forecast"}


@dataclass(frozen=True)
class Incident:
    """One event along a lineage, a run of false forecasts of one track, or a moment."""

    kind: str  # of INCIDENT_KINDS, or MOMENT
    frame: int
    until: int  # last frame: that of the event itself, but of a run its end
    row: int  # of the truth; of a run: of its first forecast object
    class_id: int
    # m, frame of the scene: of the true box or of the first false forecast
    position: tuple[float, float, float]
    # kind and number within the scene, by frame: "ids-0"; of a moment "car_turn@17"
    name: str = ""
    object_id: int = -1  # -1 for a run
    old_id: int = -1  # track that matched the object last, before this frame, or -1
    new_id: int = -1  # track that matches it now, or -1; of a run its own track
    wrong: bool = False  # a loss whose old track is still output, outside the gate
    # m, of the target's forecast then; None: not a target, or without a forecast
    minADE: float | None = None  # noqa: N815
    parts: Mapping[str, float] | None = None  # m, of its error; None: not a target
    error_before: float | None = None  # m, error of the object a frame before
    # of the object's forecast then; of a run the highest; None: no forecast
    confidence: float | None = None
    first: int = -1  # of a moment that lasts: its first frame; -1: ``frame``

    @property
    def error(self) -> float | None:
        """Sum of the parts, m: bADE, or plain error if unsplit."""
        return None if self.parts is None else sum(self.parts.values())

    @property
    def blame(self) -> float:
        """The error without the part below threshold, m."""
        parts = self.parts or {}
        return sum(value for name, value in parts.items() if name != BELOW_THRESHOLD)

    @property
    def label(self) -> str:
        """The event in the few words of a marker."""
        track_ids = dict.fromkeys((self.old_id, self.new_id))
        shown_ids = [str(track_id) for track_id in track_ids if track_id >= 0]
        return f"{_LABELS.get(self.kind, self.kind)} {' > '.join(shown_ids)}".strip()


def numbered(incidents: Iterable[Incident]) -> tuple[Incident, ...]:
    """Name incidents in the order of frames, kinds and rows."""

    def order(incident: Incident) -> tuple[int, int, int]:
        return incident.frame, INCIDENT_KINDS.index(incident.kind), incident.row

    counts = Counter[str]()
    named_incidents = []
    for incident in sorted(incidents, key=order):
        name = f"{incident.kind}-{counts[incident.kind]}"
        named_incidents.append(replace(incident, name=name))
        counts[incident.kind] += 1
    return tuple(named_incidents)
