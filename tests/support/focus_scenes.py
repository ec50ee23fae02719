"""An event in a crowd, small enough to count: what has to be bright and what dim."""

from collections.abc import Sequence

import numpy as np

from mtp_bench.viz.causes import sentence
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import FocusFrame
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene, with_detections

FRAMES, EVENT = 10, 4
MOST_BRIGHT = 16  # boxes of any kind
CARD = make_card()  # gates 2 m and 1 m; miss errors 10 m and 4 m; 2 past and 3 future frames; 10 Hz
CROWD = [(float(x), float(y)) for x in range(-30, 31, 10) for y in range(-30, 31, 10) if (x, y) != (0, 0)]


def crowd(old_y: float | None = 1.5, ahead: float = 0.0, detected: bool = True) -> Replay:
    """Car 5 drives along x past 48 parked cars; at EVENT track 1 leaves it and track 2 takes it.

    Track 1 then stands ``old_y`` m aside, or is gone (None). Until EVENT the forecasts are right, from then on they
    end ``ahead`` m ahead of where they start. Everything is detected, and forecast where it stands.
    """
    truth, tracks, said = [], [], []
    for t in range(FRAMES):
        x = 0.5 * t
        parked = [Thing(100 + i, *place) for i, place in enumerate(CROWD)]
        own = [Thing(1 if t < EVENT else 2, x, 0.0)]
        if t >= EVENT and old_y is not None:
            own.append(Thing(1, x, old_y))
        truth.append([Thing(5, x, 0.0), *parked])
        tracks.append([*own, *parked])
        step = 0.5 if t < EVENT else ahead / 3
        ways = [[[x + step * s, 0.0] for s in (1, 2, 3)], [[x + step * s, 0.3 * s] for s in (1, 2, 3)]]
        spoken = [Thing(0, x, 0.0, forecast=ways, log_weight=np.log([0.5, 0.5]))]
        said.append([*spoken, *(Thing(0, *place, forecast=[[place] * 3] * 2) for place in CROWD)])
    seen = truth if detected else [frame[1:] for frame in truth]
    scene = with_detections(make_scene(truth), seen)
    return replay(scene, make_rollout(tracks, said, samples=2), CARD, "drawn")


def bright(shown: FocusFrame) -> int:
    return len(shown.object_box) + len(shown.tracks) + len(shown.other_boxes) + len(shown.detection_box)


def told(truth: Sequence[Sequence[Thing]], tracks: Sequence[Sequence[Thing]], name: str) -> str:
    """The sentence of an event of a scene in which everything is detected."""
    run = replay(with_detections(make_scene(truth), truth), make_rollout(tracks), CARD)
    return sentence(Focus(run, run.incident(name)))
