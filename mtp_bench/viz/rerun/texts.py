"""Texts of a recording: a key to colours and lines, and the sentence and the numbers of an event, frame by frame."""

from collections.abc import Sequence

import numpy as np

from ...scoring.parts import named_parts, parts_text
from ...types import Floats
from ..evidence import distance, gate, visible
from ..focus import Focus
from ..framing import FocusFrame
from ..replay import Replay
from ..sentence import sentence

MOST_DETECTIONS = 3  # whose scores are shown
EVENT_KEY = """\
- **green box, green path**: the object, and where it really goes
- **blue**: its track before the event, with its forecast; **orange**: its track now
- **purple**: a track that has it at another time
- **light grey box**: a detection nearby, with its score, and its class where that is another one
- **cross**: place where a track was expected by its own last forecast; **grey line**: to the detection that it took
- **grey circle**: event gate of the scorer ({gate}); **long grey line**: to the ego; **pink ring**: the event

Bold: the sample that is nearest to the truth, or the heaviest if that is unknown.

The seconds around the event are played over and over in real time. Space stops, the arrow keys step. In place of
the timeline "event", "time" has the whole scene, and "frame" the numbers of its frames.
"""
SCENE_KEY = """\
### {agents}: scene {scene}

- **green box, green line**: a true object, and where it really goes; dark green: not evaluated
- **filled box in another colour**: a track, in the colour of its id, with the line behind it and its forecasts
- **dot with a name**: an event of the last frames; ids is an identity switch
- **yellow box**: a detection; red: a false one
- **white box**: the ego, which carries the sensors; **grey lines**: lanes

Hypotheses stand side by side, the heaviest first. Below: the mean error and its causes; the track that follows each
object; events on the time line.

Space plays in real time, the arrow keys step. The timeline "time" has seconds, "frame" the numbers of frames.
"""


def scene_key(replays: Sequence[Replay]) -> str:
    """Key to the views of a whole scene."""
    return SCENE_KEY.format(agents=", ".join(run.agent for run in replays), scene=replays[0].scene.name)


def event_key(focus: Focus) -> str:
    """Key to the view of an event."""
    rule = gate(focus)
    return EVENT_KEY.format(gate=f"{rule.text}, not drawn" if rule.iou else rule.text)


def event_text(focus: Focus, frame: FocusFrame) -> str:
    """The sentences of an event, and numbers of one frame."""
    t, run = frame.frame, focus.replay
    row, rows, follower = int(focus.rows[t]), {}, focus.follower(t)
    if row >= 0:
        parts = named_parts(run.part[row])
        error = f"{sum(parts.values()):.1f} m: {parts_text(parts)}"
        rows["error"] = "not a target" if np.isnan(run.part[row, 0]) else error
        rows |= {"followed by": f"no track (gate: {gate(focus).text})"} if follower < 0 else {}
    for track in frame.tracks:
        follows = "follows it, " if track.track_id == follower else ""
        off = f"{np.hypot(*(track.box[:2] - focus.place(t))):.1f} m from it, " if row >= 0 else ""
        rows[f"track {track.track_id}"] = f"{follows}{off}took {'no' if track.detection < 0 else 'a'} detection"
    detected = [f"{text}, {far:.1f} m off" for _, text, far in nearest_detections(focus, frame)]
    rows["detected"] = "; ".join(detected) or "nothing"
    far, seen = distance(focus, t), visible(focus, t)
    if far is not None:
        rows["ego"] = f"{far:.0f} m away" + ("" if seen is None else f", sees {seen:.0%}")
    heading, _, remark = f"{sentence(focus)}.".partition(". ")
    lines = [f"##### {heading}", "", remark, "", f"| {focus.seconds(t):.1f} s | frame {t} |", "|---|---|"]
    return "\n".join([*lines, *(f"| {name} | {text} |" for name, text in rows.items())])


def nearest_detections(focus: Focus, frame: FocusFrame) -> list[tuple[Floats, str, float]]:
    """Place [2], score and distance (m) of the detections nearest to the object."""
    gaps = np.hypot(*(frame.detection_box[:, :2] - focus.place(frame.frame)).T).tolist()
    rows = zip(frame.detection_box[:, :2], frame.detection_text, gaps, strict=True)
    return sorted(rows, key=lambda row: row[2])[:MOST_DETECTIONS]
