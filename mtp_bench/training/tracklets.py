"""Training windows: the tracks of a tracker, each with the true future of its object.

`windows` plays a tracker through the scenes of a split and keeps, frame by frame, the windows that a predictor would be
shown (`mtp_bench.prediction.windows`), with the truth that belongs to them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..agent import Frame, Observation, Tracker
from ..cards import Card
from ..env.environment import MTPEnv
from ..env.observation import LocalFrame, make_feed
from ..errors import MtpBenchError, UnknownNameError
from ..parallel import parallel_map
from ..prediction.windows import Surroundings, TrackWindows, windows_of
from ..running.options import DEFAULTS, Fold, RunOptions, held_out
from ..sources import open_source
from ..sources.cache import Arrays
from ..tracking import HypothesisTracker, TruthTracker
from ..tracks import Tracks
from ..types import Bools, Floats, Ints, Scene, Task, starts_of
from .labels import UNKNOWN, SceneLabels, TrackLabels
from .split import open_split
from .window_cache import cached_windows

TRUTH = "truth"  # in place of a tracker: ground-truth tracks


@dataclass(frozen=True, eq=False)
class Windows(TrackWindows):
    """Windows of n tracks with their truth, sorted by scene and frame; numbers as float32.

    Positions are in the frame of the observations of their scene, metres.
    """

    object_id: Ints  # [n] the true object that the track follows; -1: none
    present: Floats  # [n, 2] where that object is
    future: Floats  # [n, T, 2] and where it is in the next T frames
    future_known: Bools  # [n, T] its place then is known; futures that are cut short are kept
    target: Bools  # [n] the object is a target of the scorer in this frame
    scene: Ints  # [n] place in ``names``
    frame: Ints  # [n]
    moment: Ints  # [n] the frame among all frames of all scenes
    names: tuple[str, ...]
    # Of each scene, its name in its own env. Scenes of several envs with one name show the same traffic: what is held
    # out of one env must not be learnt from another one.
    own_names: tuple[str, ...]
    seen: Surroundings  # the detections of all frames of all scenes
    task: Task  # of the first env
    envs: tuple[str, ...]  # ids

    def select(self, rows: Ints | Bools | slice) -> Windows:
        """The windows ``rows``; frames and scenes keep their numbers."""
        return replace(self, **{name: getattr(self, name)[rows] for name in BY_WINDOW})

    @property
    def negative(self) -> Bools:
        """Mask [n] of the tracks that follow no true object; all False if the truth is not complete."""
        return np.asarray(self.object_id < 0)

    def split(self, fold: Fold) -> tuple[Windows, Windows]:
        """The windows to learn from, and those of the scenes of a fold, which are held out.

        It is a fold of the scenes that are here. Commands (``--fold``) take it of the whole split: their scenes may
        have been learnt from here, unless these are all scenes of the split.
        """
        away = self.of_scenes(held_out(tuple(dict.fromkeys(self.own_names)), fold))
        return self.select(~away), self.select(away)

    def of_scenes(self, own_names: Sequence[str]) -> Bools:
        """Mask [n] of the windows of the scenes that have one of these names in their own env."""
        if isinstance(own_names, str):
            raise MtpBenchError(f"own_names is {own_names!r}, expected a list of names")
        wanted = set(own_names)
        return np.asarray(np.array([name in wanted for name in self.own_names])[self.scene])

    def dataset(self) -> Any:
        """A `torch.utils.data.Dataset`: each item is a dictionary of the tensors of a window, by these names."""
        import torch
        from torch.utils.data import StackDataset

        columns: dict[str, Any] = {name: torch.from_numpy(getattr(self, name)) for name in BY_WINDOW}
        return StackDataset(**columns)


_OF_DETECTIONS = ("box", "velocity", "class_id", "score")  # columns of `Surroundings`
_OF_ALL = ("names", "own_names", "seen", "task", "envs")  # fields without a value per window
BY_WINDOW = tuple(f.name for f in fields(Windows) if f.name not in _OF_ALL)


def windows(
    env_id: str,
    split: str = "train",
    tracker: Tracker | int | str = 1,
    scenes: int | Sequence[str] | None = None,
    options: RunOptions = DEFAULTS,
) -> Windows:
    """Windows of every track of every hypothesis, at every frame of the scenes of a split.

    ``tracker``: your own tracker, the number of hypotheses of `HypothesisTracker`, or "truth" for true ones.
    ``scenes``: how many, the first ones, or their names; None: those of ``options``. ``options``: data root, detector,
    workers and progress.

    A track follows the true object of its class that is nearest to the last detection it took, within the forecast gate
    of the card; of true boxes, the object itself. Tracks of which that is unknown, since the truth is not complete or
    neutral there, are left out. Windows of "truth" and of a number of hypotheses are cached; your own tracker runs each
    time. Raises UnknownNameError for a scene that does not exist, MtpBenchError for another ``tracker`` and if there is
    no track to learn from.
    """
    _require_tracker(tracker)
    scenes = int(scenes) if isinstance(scenes, np.integer) else scenes
    if isinstance(scenes, str | bool) or not (scenes is None or isinstance(scenes, int | Sequence)):
        raise MtpBenchError(f"scenes is {scenes!r}, expected a number of scenes or a list of their names")
    first = scenes if isinstance(scenes, int) else options.scenes
    opened = open_split(env_id, replace(options, split=split, scenes=first))
    names = opened.names if scenes is None or isinstance(scenes, int) else tuple(scenes)
    for place, name in enumerate(names):
        if name not in opened.source.names:
            raise UnknownNameError(f"scene of {env_id}", name, opened.source.names)
        if name in names[:place]:
            raise MtpBenchError(f"scene {name!r} is named twice, expected each once: it would be learnt twice")
    tracker = int(tracker) if isinstance(tracker, (int, np.integer)) else tracker
    observe = "truth" if tracker == TRUTH else "detections"
    task = MTPEnv(opened.card, data=options.data, observe=observe).task
    options.progress.started(len(names))
    calls = [(opened.card, options.data, task, tracker, name) for name in names]
    parts = parallel_map(_scene_arrays, calls, options.workers, lambda place: options.progress.done(names[place]))
    if not any(len(part["scene"]) for part in parts):
        raise MtpBenchError(f"{env_id}: no track of the {len(names)} scenes of split {split!r} can be learnt from")
    return join_scenes(parts, names, task)


def _require_tracker(tracker: object) -> None:
    """Raise MtpBenchError unless ``tracker`` is a tracker, a number of hypotheses, or "truth"."""
    if isinstance(tracker, str):
        known = tracker == TRUTH
    elif isinstance(tracker, (int, np.integer)):
        known = bool(tracker >= 1) and not isinstance(tracker, bool)
    else:
        methods = all(callable(getattr(tracker, name, None)) for name in ("reset", "step"))
        known = methods and not isinstance(tracker, type)
    if not known:
        raise MtpBenchError(
            f"tracker is {tracker!r}, expected {TRUTH!r}, a number of hypotheses of at least 1, or a tracker of your "
            "own, with reset(task) and step(observation)"
        )


def join_scenes(parts: Sequence[Arrays], names: Sequence[str], task: Task) -> Windows:
    """The windows of several scenes, each as `scene_arrays` gives it."""
    first = np.cumsum([0, *(len(part["seen_start"]) - 1 for part in parts)])
    for number, part in enumerate(parts):
        part["scene"] = np.full(len(part["scene"]), number)
        part["moment"] = part["frame"] + first[number]
    seen = {name: np.concatenate([part[f"seen_{name}"] for part in parts]) for name in _OF_DETECTIONS}
    before = np.concatenate([np.arange(len(part["seen_start"]) - 1) for part in parts])
    count = np.concatenate([np.diff(part["seen_start"]) for part in parts])
    rows = {name: np.concatenate([part[name] for part in parts]) for name in BY_WINDOW}
    surroundings = Surroundings(starts_of(count), **seen, before=before)
    own = tuple(names)
    return Windows(**rows, names=own, own_names=own, seen=surroundings, task=task, envs=(task.env_id,))


def concatenate(parts: Sequence[Windows]) -> Windows:
    """The windows of several envs, with the task of the first."""
    scenes = np.cumsum([0, *(len(part.names) for part in parts)])
    frames = np.cumsum([0, *(part.seen.frames for part in parts)])
    moved = [
        replace(part, scene=part.scene + scene, moment=part.moment + frame)
        for part, scene, frame in zip(parts, scenes, frames, strict=False)
    ]
    rows = {name: np.concatenate([getattr(part, name) for part in moved]) for name in BY_WINDOW}
    columns = (*_OF_DETECTIONS, "before")
    seen = {name: np.concatenate([getattr(part.seen, name) for part in parts]) for name in columns}
    start = starts_of(np.concatenate([part.seen.counts for part in parts]))
    names = tuple(f"{part.task.env_id} {name}" if len(parts) > 1 else name for part in parts for name in part.names)
    own_names, envs = (tuple(one for part in parts for one in getattr(part, name)) for name in ("own_names", "envs"))
    surroundings = Surroundings(start, **seen)
    return Windows(**rows, names=names, own_names=own_names, seen=surroundings, task=parts[0].task, envs=envs)


def _scene_arrays(card: Card, data: str | None, task: Task, tracker: Tracker | int | str, name: str) -> Arrays:
    scene = open_source(card, data).load(name)
    if not isinstance(tracker, int | str):
        return scene_arrays(scene, card, task, tracker)
    known: Tracker = TruthTracker() if isinstance(tracker, str) else HypothesisTracker(tracker)
    return cached_windows(scene, (card.digest, task, tracker), lambda: scene_arrays(scene, card, task, known))


def scene_arrays(scene: Scene, card: Card, task: Task, tracker: Tracker) -> Arrays:
    """The columns of `Windows` for one scene, and its detections as ``seen_*``."""
    local = LocalFrame.of(scene)
    feed = make_feed(scene, local, task)
    labels = SceneLabels(scene, card, local, feed)
    tracker.reset(task)
    parts, seen = [_no_windows(task)], deque[Observation](maxlen=task.past)
    for t in range(scene.frames):
        seen.append(feed.observe(t))
        tracks = tracker.step(seen[-1])
        if not np.isfinite(tracks.box).all():
            raise MtpBenchError(f"scene {scene.name!r}, frame {t}: the tracker gave a box that is not finite")
        frame_windows, _ = windows_of(Frame(t, tracks, tuple(seen)), task.past)
        parts.append(_labelled(frame_windows, labels.of(t, frame_windows), t))
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    detections = {f"seen_{name}": _single_precision(getattr(feed, name)) for name in _OF_DETECTIONS}
    return {**rows, "seen_start": feed.start, **detections}


def _labelled(frame_windows: TrackWindows, labels: TrackLabels, t: int) -> Arrays:
    """The windows of frame ``t`` whose object is known, or known to be none, with their labels."""
    known = labels.object_id != UNKNOWN
    columns = {f.name: getattr(frame_windows, f.name) for f in fields(TrackWindows)} | labels._asdict()
    rows = {name: _single_precision(value[known]) for name, value in columns.items()}
    return {**rows, "scene": np.zeros(known.sum(), dtype=np.int64), "frame": np.full(known.sum(), t)}


def _no_windows(task: Task) -> Arrays:
    """Columns without rows, for a scene without windows."""
    no_tracks = Tracks.of_one_hypothesis(np.zeros(0, dtype=np.int64), np.zeros((0, 7)), np.zeros(0, dtype=np.int64))
    empty, _ = windows_of(Frame(0, no_tracks, ({},)), task.past)
    ids, future = np.zeros(0, dtype=np.int64), np.zeros((0, task.future, 2))
    return _labelled(empty, TrackLabels(ids, np.zeros((0, 2)), future, future[:, :, 0] > 0, ids > 0), 0)


def _single_precision(values: NDArray[Any]) -> NDArray[Any]:
    """The values, numbers in single precision."""
    return values.astype(np.float32) if values.dtype.kind == "f" else np.asarray(values)
