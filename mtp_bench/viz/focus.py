"""An event alone: what belongs to it, which is bright in pictures, videos and recordings, and what is dim.

Nothing is drawn here. Boxes and places are in the frame of reference of the scene, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..geometry import rotate
from ..types import Floats, Ints
from .case import Case, ObjectForecast, counterpart
from .palette import BEFORE, BLACK, DIM, EVENT, NOW, TRUTH
from .replay import NO_EVENT, Incident, Replay
from .sentence import sentence

MOST_DETECTIONS = 6  # that are bright: the nearest
MOST_BRIGHT = 12  # boxes of any kind
TRAIL_SECONDS = 3.0
LARGEST = 60.0  # m, half of what a picture shows
MARGIN = 1.12  # of what has to be seen
OFF_CENTER = 0.3  # of half a picture: the object stays in the middle third
ROLES = {  # role of a thing in the event -> its colour
    "truth": TRUTH, "before": BEFORE, "now": NOW, "detection": BLACK, "event": EVENT, "dim": DIM,
}  # fmt: skip


class Key(NamedTuple):
    """One line of the key."""

    role: str  # of ROLES
    mark: str  # "box", "other", "path", "forecast", "ring"
    text: str


@dataclass(frozen=True)
class Window:
    """The part of the world that a picture shows at least."""

    x: float  # m, its centre
    y: float  # m
    wide: float  # m
    high: float  # m
    turn: float = 0.0  # rad, the direction of the world that points to the right; 0: north is up


class Follower(NamedTuple):
    """One of the tracks of the event in a frame."""

    track_id: int
    role: str  # "before" or "now"
    box: Floats  # [7]
    trail: Floats  # [n, 2], the newest place last


@dataclass(frozen=True, eq=False)
class FocusFrame:
    """One frame: what is bright, and what is dim."""

    frame: int
    object_box: Floats  # [0 or 1, 7] the true object
    follower: int  # id of the track that follows it, -1 without one
    past: Floats  # [n, 2] places of the object, now first
    future: Floats  # [n, 2] places of the object, now first
    tracks: tuple[Follower, ...]  # those of the event that are output
    others: Floats  # [n, 7] true boxes that these tracks follow besides the object
    other_names: tuple[str, ...]  # n, such as "car 8"
    detection_box: Floats  # [D, 7] the nearest
    dim_truth: Floats  # [n, 7]
    dim_track: Floats  # [n, 7]
    dim_detection: Floats  # [n, 7]

    @property
    def bright(self) -> int:
        """Number of bright boxes, at most MOST_BRIGHT."""
        return len(self.object_box) + len(self.tracks) + len(self.others) + len(self.detection_box)

    @property
    def event_box(self) -> Floats:
        """Boxes [n, 7] of the object and of the tracks of the event."""
        return np.concatenate([self.object_box, *(track.box[None] for track in self.tracks)])


@dataclass(frozen=True, eq=False)
class Focus:
    """An event of a run with what belongs to it."""

    case: Case
    facing: float | None = None  # rad, direction that points to the right; None: that of the object's way

    @classmethod
    def of(cls, replay: Replay, at: Incident) -> Focus:
        """The event ``at`` of a run."""
        return cls(Case(replay, at))

    @classmethod
    def of_all(cls, replays: Sequence[Replay], at: Incident) -> list[Focus]:
        """The event ``at`` of the first of several runs of a scene, and its counterparts, seen the same way."""
        first = cls.of(replays[0], at)
        return [first, *(cls(Case(run, counterpart(run, at)), first.turn) for run in replays[1:])]

    @property
    def bold(self) -> str:
        """Reason why a sample of a forecast is drawn bold, in words."""
        known = len(self.case.future(self.at.frame)) > 1
        return "is nearest to the truth" if known else "has the most weight"

    @property
    def replay(self) -> Replay:
        """The run."""
        return self.case.replay

    @property
    def at(self) -> Incident:
        """The event."""
        return self.case.at

    @property
    def named(self) -> str:
        """Name of the object, such as "car 8"."""
        return f"{self.case.noun} {self.at.object_id}"

    @cached_property
    def sentence(self) -> str:
        """The event in one sentence."""
        return sentence(self.case)

    def ringed(self, t: int) -> bool:
        """True from the event on; for a false forecast as long as it lasts."""
        return t >= self.at.frame and (t <= self.at.until or self.at.kind != "spurious")

    def forecasts(self, t: int) -> list[tuple[str, ObjectForecast]]:
        """The forecasts that a picture of frame ``t`` shows, each with its role, the most important one last.

        From the event on the one before it stays in sight: the switch has spoilt it.
        """
        newest, before = self._forecast(t), None
        if t < self.at.frame:
            return [] if newest is None else [("before", newest)]
        if self.at.frame and self.at.kind != "spurious":
            before = self._forecast(self.at.frame - 1)
        return [(role, each) for role, each in (("before", before), ("now", newest)) if each is not None]

    def _forecast(self, t: int) -> ObjectForecast | None:
        if t not in self._known_forecasts:
            self._known_forecasts[t] = self.case.forecast(t)
        return self._known_forecasts[t]

    @cached_property
    def _known_forecasts(self) -> dict[int, ObjectForecast | None]:
        return {}

    def frame(self, t: int) -> FocusFrame:
        """Content of a picture of frame ``t``."""
        case, truth, scene = self.case, self.replay.scene.truth, self.replay.scene
        rollout, back = self.replay.rollout, round(TRAIL_SECONDS * self.replay.card.task.rate)
        # a track that is found again under its own id is that of "now"
        roles = {self.at.old_id: "before", self.at.new_id: "now"}
        rows = {track_id: row for track_id in roles if (row := case.track_row(track_id, t)) >= 0}
        tracks = tuple(
            Follower(i, roles[i], rollout.track_box[row].astype(np.float64), case.trail(i, t, 1 + back))
            for i, row in rows.items()
        )
        own = case.rows[t : t + 1][case.rows[t : t + 1] >= 0]
        followed = np.array([case.followed(track_id, t) for track_id in rows], dtype=np.int64)
        others = np.unique(followed[followed >= 0])
        near = case.detections(t)[:MOST_DETECTIONS]
        dim_tracks = np.setdiff1d(case.track_rows(t), list(rows.values()))
        return FocusFrame(
            frame=t,
            object_box=truth.box[own],
            follower=case.follower(t),
            past=case.path(t, t - back),
            future=case.future(t),
            tracks=tracks,
            others=truth.box[others],
            other_names=tuple(case.name_of(int(row)) for row in others),
            detection_box=scene.detections.box[near],
            dim_truth=truth.box[_rest(truth.rows(t), own, others)],
            dim_track=rollout.track_box[dim_tracks].astype(np.float64),
            dim_detection=scene.detections.box[_rest(scene.detections.rows(t), near)],
        )

    @cached_property
    def turn(self) -> float:
        """Direction (rad) of the object's way: of its future, else its past or its forecast, else its heading."""
        if self.facing is not None:
            return self.facing
        t = self.at.frame
        now = self._forecast(t)
        ways = [self.case.future(t), self.case.path(t, max(0, t - self.replay.frames))[::-1]]
        for way in [*ways, *([now.nearest_path] if now is not None else [])]:
            if len(way) > 1 and np.hypot(*(way[-1] - way[0])) > max(1.0, 0.5 * self.length):
                return float(np.arctan2(*(way[-1] - way[0])[::-1]))
        row = self.case.rows[t]
        return float(self.replay.scene.truth.box[row, 3]) if row >= 0 else 0.0

    @property
    def height(self) -> float:
        """Height of the event's place, m."""
        return self.at.position[2]

    @cached_property
    def length(self) -> float:
        """Length of the object, m."""
        boxes = self.frame(self.at.frame).event_box
        return float(boxes[0, 4]) if len(boxes) else 2.0

    def window(self) -> Window:
        """Window of the picture of the event: the object in its middle third, its future and its forecasts."""
        t = self.at.frame
        paths = [self.case.future(t), *(forecast.nearest_path for _, forecast in self.forecasts(t))]
        points = np.concatenate([*paths, self.frame(t).event_box[:, :2]])
        place = self.case.place(t)
        gap = rotate(np.concatenate([points, place[None]]) - place, -self.turn)
        low, high = np.minimum(gap.min(axis=0), 0.0) * MARGIN, np.maximum(gap.max(axis=0), 0.0) * MARGIN
        half = np.maximum((high - low) / 2, np.maximum(high, -low) / (1 + OFF_CENTER))
        half = np.clip(half, 1.5 + 1.2 * self.length, LARGEST)
        center = place + rotate(np.clip((low + high) / 2, -OFF_CENTER * half, OFF_CENTER * half), self.turn)
        return Window(float(center[0]), float(center[1]), float(2 * half[0]), float(2 * half[1]), self.turn)

    def close_window(self, t: int) -> Window:
        """Window of a small picture of frame ``t``: the object and its tracks from near, all three at one scale."""
        box = self.frame(self.at.frame).event_box
        reach = np.hypot(*(box[:, :2] - self.case.place(self.at.frame)).T) + box[:, 4] / 2
        half = float(np.clip(1.3 * reach.max(initial=0.0), 1.2 + 0.8 * self.length, 12.0))
        x, y = self.case.place(t).tolist()
        return Window(x, y, 2 * half, 2 * half, self.turn)

    @cached_property
    def key(self) -> tuple[Key, ...]:
        """Meaning of the marks of the picture of the event."""
        at, shown, lines = self.at, self.frame(self.at.frame), []
        last = at.frame + max(len(self.case.future(at.frame)) - 1, 0)
        known = self.case.seconds(last) - self.case.seconds(at.frame)
        if len(shown.object_box):
            lines += [Key("truth", "box", f"{self.named}, true box")]
        if known > 0:
            lines += [Key("truth", "path", f"where it really goes in {round(known, 1):g} s")]
        if len(shown.others):
            lines += [Key("truth", "other", "true object of the other track")]
        for track in shown.tracks:
            lines += [Key(track.role, "box", f"track {track.track_id}, its track {track.role}")]
        for role, forecast in self.forecasts(at.frame):
            when = "a frame before" if role == "before" else "now"
            owner = f"of track {forecast.track_id}" if forecast.track_id >= 0 else "of no track"
            lines += [Key(role, "forecast", f"forecast {when}, {owner}")]
        if len(shown.detection_box):
            lines += [Key("detection", "box", f"detections within {self.case.near:g} m")]
        ring = "the event of the other run" if at.kind == NO_EVENT else "the event"
        return (*lines, Key("event", "ring", ring), Key("dim", "box", "all other boxes"))


def _rest(rows: slice, *shown: Ints) -> Ints:
    """The rows of a frame that are not shown otherwise."""
    return np.setdiff1d(np.arange(rows.start, rows.stop), np.concatenate(shown))
