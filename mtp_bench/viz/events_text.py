"""Events in words."""

from __future__ import annotations

from collections.abc import Sequence

from .replay import Incident


def incident_text(incident: Incident, classes: Sequence[str]) -> str:
    """One line: what happened to whom, and what the forecast of that frame was worth."""
    what = f"{incident.name}: {_happened(incident, classes[incident.class_id])}"
    if incident.error is not None:
        return f"{what}; forecast off by {incident.error:.2f} m"
    if incident.capped is not None and incident.kind != "spurious":
        return f"{what}; no forecast"
    return what


def _happened(incident: Incident, noun: str) -> str:
    who = f"{noun} {incident.object_id}"
    if incident.kind == "ids":
        return f"{who} was track {incident.old_id}, is track {incident.new_id}"
    if incident.kind == "lost":
        return f"{who} is lost by track {incident.old_id}" + (", which is elsewhere" if incident.wrong else "")
    if incident.kind == "reacquired":
        return f"{who} is found again as track {incident.new_id}"
    track = f" of track {incident.new_id}" if incident.new_id >= 0 else ""
    return f"false forecast of a {noun}{track}, until frame {incident.until}"
