"""Windows of tracklets with their truth, from a tracker played through the scenes.

They are those that a predictor would be shown (`mtp_bench.prediction.windows`), with
the truth that belongs to them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from os import PathLike
from typing import Any, Self

import numpy as np

from ..agent import Frame, Tracker
from ..cards import Card
from ..core import (
    Bools,
    Floats,
    Ints,
    MtpBenchError,
    Observation,
    Scene,
    Task,
    long_work,
    parallel_map,
    starts_of,
)
from ..env import LocalFrame, make_feed
from ..prediction import LANE_FIELDS, Surroundings, TrackWindows, lanes_of, windows_of
from ..running import DEFAULTS, Fold, RunOptions, held_out, resolve_options
from ..scoring import pieces
from ..sources import open_source
from ..tracking import HypothesisTracker, TruthTracker
from .labels import UNKNOWN, SceneLabels
from .split import open_split

TRUTH = "truth"  # in place of a tracker: ground-truth tracks


@dataclass(frozen=True, eq=False, repr=False)
class Windows(TrackWindows):
    """Windows of n tracks with their truth, sorted by scene and frame.

    Numbers are float32. Positions are in the frame of the observations of their scene,
    metres. Selected windows keep the numbers of their frames and scenes.
    """

    object_id: Ints  # [n] the true object that the track follows; -1: none
    present: Floats  # [n, 2] where that object is
    future: Floats  # [n, T, 2] and where it is in the next T frames
    # [n, T] its place then is known; futures that are cut short are kept
    future_known: Bools
    target: Bools  # [n] the object is a target of the scorer in this frame
    scene: Ints  # [n] index into ``names``
    frame: Ints  # [n]
    moment: Ints  # [n] the frame among all frames of all scenes
    names: tuple[str, ...]
    # Of each scene, its name in its own env. Scenes of several envs with one name show
    # the same traffic: what is held out of one env must not be learnt from another one.
    own_names: tuple[str, ...]
    surroundings: Surroundings  # detections and lanes of all frames of all scenes
    task: Task  # of the first env
    envs: tuple[str, ...]  # ids

    def __repr__(self) -> str:
        names = ("box", "future", "future_known")
        shapes = [f"{name} {list(getattr(self, name).shape)}" for name in names]
        return (
            f"Windows of {', '.join(self.envs)}: {len(self)} windows of "
            f"{len(self.names)} scenes, {int(self.target.sum())} at targets\n"
            f"{', '.join(shapes)}"
        )

    def split(self, fold: Fold) -> tuple[Self, Self]:
        """Return windows to learn from, and those of a fold.

        It is a fold of the scenes that are here. Commands (``--fold``) take it of the
        whole split: their scenes may have been learnt from here, unless these are all
        scenes of the split.
        """
        scene_names = tuple(dict.fromkeys(self.own_names))
        away = self.of_scenes(held_out(scene_names, fold))
        return self.select(~away), self.select(away)

    def of_scenes(self, own_names: Sequence[str]) -> Bools:
        """Return a mask [n] of windows of scenes with these own names."""
        is_named = np.isin(np.array(self.own_names), list(own_names))
        return np.asarray(is_named[self.scene])


# fields without a value per window
_OF_ALL = ("names", "own_names", "surroundings", "task", "envs")
BY_WINDOW = tuple(f.name for f in fields(Windows) if f.name not in _OF_ALL)


def windows(
    env_id: str,
    split: str = "train",
    tracker: Tracker | int | str = 1,
    scenes: int | Sequence[str] | None = None,
    options: RunOptions = DEFAULTS,
    data: str | PathLike[str] | None = None,
    jobs: int | None = None,
) -> Windows:
    """Return windows of every track of every hypothesis, at every frame.

    ``tracker``: your own tracker, the number of hypotheses of `HypothesisTracker`, or
    "truth" for true ones. ``scenes``: how many scenes of the split, the first ones, or
    their names; None: those of ``options``. ``data``: data root. ``jobs``: processes;
    0: one per core. ``options``: data root, detector, workers and progress.

    A track follows the true object of its class that is nearest to the last detection
    it took, within the forecast gate of the card; of true boxes, the object itself.
    Tracks are left out where the truth does not tell that: it is not complete, or
    neutral there. Raises UnknownNameError for a scene that does not exist,
    MtpBenchError for another ``tracker`` and if there is no track to learn from.
    """
    track_with = _tracker_of(tracker)
    keywords = {"scenes": scenes, "data": data, "jobs": jobs}
    keywords = {name: value for name, value in keywords.items() if value is not None}
    env, options = resolve_options(env_id, options, keywords)
    opened = open_split(env, replace(options, split=split))
    names = opened.names
    task = opened.task(
        "truth" if isinstance(track_with, TruthTracker) else "detections"
    )
    calls = [(opened.card, options.data, task, track_with, name) for name in names]
    with long_work(
        f"reading windows of {env_id}", progress=options.progress
    ) as progress:
        progress.started(len(names))
        parts = parallel_map(
            _load_windows,
            calls,
            options.workers,
            lambda index: progress.done(names[index]),
        )
    if not any(map(len, parts)):
        raise MtpBenchError(
            f"{env_id}: no track of the {len(names)} scenes of split {split!r} can be "
            "learnt from"
        )
    return concatenate(parts)


def _tracker_of(tracker: Any) -> Tracker:
    """Return the tracker that the argument of `windows` stands for.

    Raises MtpBenchError for anything else.
    """
    if isinstance(tracker, str) and tracker == TRUTH:
        return TruthTracker()
    is_number = isinstance(tracker, int | np.integer) and not isinstance(tracker, bool)
    if is_number and int(tracker) >= 1:
        return HypothesisTracker(int(tracker))
    methods = [getattr(tracker, name, None) for name in ("reset", "step")]
    if not isinstance(tracker, type) and all(map(callable, methods)):
        return tracker  # type: ignore[no-any-return]
    raise MtpBenchError(
        f"tracker is {tracker!r}, expected {TRUTH!r}, a number of hypotheses of at "
        "least 1, or a tracker of your own, with reset(task) and step(observation)"
    )


def concatenate(parts: Sequence[Windows]) -> Windows:
    """Return windows of several scenes or envs.

    The task is that of the first one.
    """
    window_columns = _concatenate_columns(parts, BY_WINDOW)
    windows_per_part = [len(part) for part in parts]
    first_scenes = starts_of([len(part.names) for part in parts])[:-1]
    first_moments = starts_of([part.surroundings.frames for part in parts])[:-1]
    window_columns["scene"] += np.repeat(first_scenes, windows_per_part)
    window_columns["moment"] += np.repeat(first_moments, windows_per_part)
    envs = tuple(dict.fromkeys(env_id for part in parts for env_id in part.envs))
    names: list[str] = []
    own_names: list[str] = []
    for part in parts:
        own_names += part.own_names
        if len(envs) == 1:
            names += part.names
        else:
            names += [f"{part.task.env_id} {name}" for name in part.names]
    return Windows(
        **window_columns,
        names=tuple(names),
        own_names=tuple(own_names),
        surroundings=_concatenate_surroundings([part.surroundings for part in parts]),
        task=parts[0].task,
        envs=envs,
    )


def _concatenate_columns(
    records: Sequence[Any], column_names: Sequence[str]
) -> dict[str, np.ndarray]:
    return {
        column_name: np.concatenate(
            [getattr(record, column_name) for record in records]
        )
        for column_name in column_names
    }


def _concatenate_surroundings(parts: Sequence[Surroundings]) -> Surroundings:
    """Return the surroundings of all frames.

    Lanes are in all parts or in none.
    """
    columns = _concatenate_columns(
        parts, ("box", "velocity", "class_id", "score", "before")
    )
    lanes = {
        lane_field: np.concatenate([part.lanes[lane_field] for part in parts])
        for lane_field in parts[0].lanes
    }
    counts = np.concatenate([part.counts for part in parts])
    return Surroundings(starts_of(counts), **columns, lanes=lanes)


def _load_windows(
    card: Card, data: str | None, task: Task, tracker: Tracker, scene_name: str
) -> Windows:
    return windows_of_scene(
        open_source(card, data).load(scene_name), card, task, tracker
    )


def windows_of_scene(scene: Scene, card: Card, task: Task, tracker: Tracker) -> Windows:
    """Return the windows of one scene."""
    local = LocalFrame.of(scene)
    feed = make_feed(scene, local, task, card)
    labels = SceneLabels(scene, card, local, feed)
    tracker.reset(task)
    parts: list[dict[str, np.ndarray]] = []
    recent = deque[Observation](maxlen=task.past)
    lanes: list[Observation] = []
    for t in range(scene.frames):
        observation = feed.observe(t)
        if task.after_hole(observation):
            recent.clear()
        recent.append(observation)
        lanes.append(
            {name: observation[name] for name in LANE_FIELDS if name in observation}
        )
        tracks = tracker.step(observation)
        if not np.isfinite(tracks.box).all():
            raise MtpBenchError(
                f"scene {scene.name!r}, frame {t}: the tracker gave a box that is not "
                "finite"
            )
        frame_windows, _ = windows_of(Frame(t, tracks, tuple(recent)), task.past)
        parts.append(_labelled(frame_windows, labels, t))
    window_rows = {
        name: np.concatenate([part[name] for part in parts]) for name in parts[0]
    }
    piece = pieces(scene, card)
    surroundings = Surroundings(
        feed.start,
        _single_precision(feed.box),
        _single_precision(feed.velocity),
        feed.class_id,
        _single_precision(feed.score),
        # frames before each one without a hole in time
        before=np.arange(scene.frames) - np.searchsorted(piece, piece),
        lanes=lanes_of(lanes),
    )
    return Windows(
        **window_rows,
        scene=np.zeros(len(window_rows["frame"]), dtype=np.int64),
        moment=window_rows["frame"],
        names=(scene.name,),
        own_names=(scene.name,),
        surroundings=surroundings,
        task=task,
        envs=(task.env_id,),
    )


def _labelled(
    frame_windows: TrackWindows, scene_labels: SceneLabels, t: int
) -> dict[str, np.ndarray]:
    """Return the windows of frame ``t`` with their labels.

    Windows are left out if the truth does not tell which object they follow.
    """
    labels = scene_labels.at(t, frame_windows)
    is_known = labels.object_id != UNKNOWN
    rows = {
        column_name: _single_precision(value[is_known])
        for column_name, value in (vars(frame_windows) | labels._asdict()).items()
    }
    return {**rows, "frame": np.full(is_known.sum(), t)}


def _single_precision(values: np.ndarray) -> np.ndarray:
    """Return floats in single precision, and other types as they are."""
    return values.astype(np.float32) if values.dtype.kind == "f" else np.asarray(values)
