"""Windows of tracklets with their truth, from a tracker played through the scenes of a split.

They are those that a predictor would be shown (`mtp_bench.prediction.windows`), with the truth that belongs to them.
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
    Tracks,
    long_work,
    parallel_map,
    require_known,
    starts_of,
)
from ..env import LocalFrame, MTPEnv, make_feed
from ..prediction import LANES, Surroundings, TrackWindows, lanes_of, windows_of
from ..running import DEFAULTS, Fold, RunOptions, held_out, resolve_options
from ..scoring import pieces
from ..sources import open_source
from ..tracking import HypothesisTracker, TruthTracker
from .labels import UNKNOWN, SceneLabels, TrackLabels
from .split import open_split

TRUTH = "truth"  # in place of a tracker: ground-truth tracks


@dataclass(frozen=True, eq=False, repr=False)
class Windows(TrackWindows):
    """Windows of n tracks with their truth, sorted by scene and frame; numbers as float32.

    Positions are in the frame of the observations of their scene, metres.
    """

    object_id: Ints  # [n] the true object that the track follows; -1: none
    present: Floats  # [n, 2] where that object is
    future: Floats  # [n, T, 2] and where it is in the next T frames
    future_known: (
        Bools  # [n, T] its place then is known; futures that are cut short are kept
    )
    target: Bools  # [n] the object is a target of the scorer in this frame
    scene: Ints  # [n] place in ``names``
    frame: Ints  # [n]
    moment: Ints  # [n] the frame among all frames of all scenes
    names: tuple[str, ...]
    # Of each scene, its name in its own env. Scenes of several envs with one name show the same traffic: what is held
    # out of one env must not be learnt from another one.
    own_names: tuple[str, ...]
    seen: Surroundings  # detections and lanes of all frames of all scenes
    task: Task  # of the first env
    envs: tuple[str, ...]  # ids

    def __repr__(self) -> str:
        shapes = (
            f"{name} {list(getattr(self, name).shape)}"
            for name in ("box", "future", "future_known")
        )
        size = f"{len(self.frame)} windows of {len(self.names)} scenes, {int(self.target.sum())} at targets"
        return f"Windows of {', '.join(self.envs)}: {size}\n{', '.join(shapes)}"

    def select(self, rows: Ints | Bools | slice) -> Self:
        """The windows ``rows``; frames and scenes keep their numbers."""
        return replace(self, **{name: getattr(self, name)[rows] for name in BY_WINDOW})

    def split(self, fold: Fold) -> tuple[Self, Self]:
        """The windows to learn from, and those of the scenes of a fold, which are held out.

        It is a fold of the scenes that are here. Commands (``--fold``) take it of the whole split: their scenes may
        have been learnt from here, unless these are all scenes of the split.
        """
        away = self.of_scenes(held_out(tuple(dict.fromkeys(self.own_names)), fold))
        return self.select(~away), self.select(away)

    def of_scenes(self, own_names: Sequence[str]) -> Bools:
        """Mask [n] of the windows of the scenes that have one of these names in their own env."""
        return np.asarray(
            np.isin(np.array(self.own_names), list(own_names))[self.scene]
        )


_OF_ALL = (
    "names",
    "own_names",
    "seen",
    "task",
    "envs",
)  # fields without a value per window
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
    """Windows of every track of every hypothesis, at every frame of the scenes of a split.

    ``tracker``: your own tracker, the number of hypotheses of `HypothesisTracker`, or "truth" for true ones.
    ``scenes``: how many, the first ones, or their names; None: those of ``options``. ``data``: data root. ``jobs``:
    processes; 0: one per core. ``options``: data root, detector, workers and progress.

    A track follows the true object of its class that is nearest to the last detection it took, within the forecast gate
    of the card; of true boxes, the object itself. Tracks of which that is unknown, since the truth is not complete or
    neutral there, are left out. Raises UnknownNameError for a scene that does not exist, MtpBenchError for another
    ``tracker`` and if there is no track to learn from.
    """
    played = _tracker_of(tracker)
    given = {"data": data, "jobs": jobs}
    _, options = resolve_options(
        env_id,
        options,
        {name: value for name, value in given.items() if value is not None},
    )
    count = int(scenes) if isinstance(scenes, int | np.integer) else None
    if isinstance(scenes, str | bool) or not (
        scenes is None or count is not None or isinstance(scenes, Sequence)
    ):
        raise MtpBenchError(
            f"scenes is {scenes!r}, expected a number of scenes or a list of their names"
        )
    opened = open_split(
        env_id,
        replace(
            options, split=split, scenes=options.scenes if count is None else count
        ),
    )
    names = opened.names if scenes is None or count is not None else tuple(scenes)  # type: ignore[arg-type]
    for place, name in enumerate(names):
        require_known(f"scene of {env_id}", name, opened.source.names)
        if name in names[:place]:
            raise MtpBenchError(
                f"scene {name!r} is named twice, expected each once: it would be learnt twice"
            )
    observe = "truth" if isinstance(played, TruthTracker) else "detections"
    task = MTPEnv(opened.card, data=options.data, observe=observe).task
    calls = [(opened.card, options.data, task, played, name) for name in names]
    with long_work(
        f"reading windows of {env_id}", progress=options.progress
    ) as progress:
        progress.started(len(names))
        parts = parallel_map(
            _load_windows,
            calls,
            options.workers,
            lambda place: progress.done(names[place]),
        )
    found = concatenate(parts) if parts else None
    if not found:
        raise MtpBenchError(
            f"{env_id}: no track of the {len(names)} scenes of split {split!r} can be learnt from"
        )
    return found


def _tracker_of(tracker: Any) -> Tracker:
    """The tracker that the argument of `windows` stands for; raises MtpBenchError for anything else."""
    if isinstance(tracker, str) and tracker == TRUTH:
        return TruthTracker()
    if (
        isinstance(tracker, int | np.integer)
        and not isinstance(tracker, bool)
        and tracker >= 1
    ):
        return HypothesisTracker(int(tracker))
    if not isinstance(tracker, type) and all(
        callable(getattr(tracker, name, None)) for name in ("reset", "step")
    ):
        return tracker  # type: ignore[no-any-return]
    raise MtpBenchError(
        f"tracker is {tracker!r}, expected {TRUTH!r}, a number of hypotheses of at least 1, or a tracker of your own, "
        "with reset(task) and step(observation)"
    )


def concatenate(parts: Sequence[Windows]) -> Windows:
    """The windows of several scenes or envs, with the task of the first."""
    scenes = np.cumsum([0, *(len(part.names) for part in parts)])
    frames = np.cumsum([0, *(part.seen.frames for part in parts)])
    moved = [
        replace(part, scene=part.scene + scene, moment=part.moment + frame)
        for part, scene, frame in zip(parts, scenes, frames, strict=False)
    ]
    rows = {
        name: np.concatenate([getattr(part, name) for part in moved])
        for name in BY_WINDOW
    }
    columns = [f.name for f in fields(Surroundings) if f.name not in ("start", "lanes")]
    around: dict[str, Any] = {
        name: np.concatenate([getattr(part.seen, name) for part in parts])
        for name in columns
    }
    shown = parts[0].seen.lanes  # by all or by none
    around["lanes"] = {
        name: np.concatenate([part.seen.lanes[name] for part in parts])
        for name in shown
    }
    seen = Surroundings(
        starts_of(np.concatenate([part.seen.counts for part in parts])), **around
    )
    envs = tuple(dict.fromkeys(env_id for part in parts for env_id in part.envs))
    names = tuple(
        name if len(envs) == 1 else f"{part.task.env_id} {name}"
        for part in parts
        for name in part.names
    )
    own_names = tuple(name for part in parts for name in part.own_names)
    return Windows(
        **rows,
        names=names,
        own_names=own_names,
        seen=seen,
        task=parts[0].task,
        envs=envs,
    )


def _load_windows(
    card: Card, data: str | None, task: Task, tracker: Tracker, name: str
) -> Windows:
    return windows_of_scene(open_source(card, data).load(name), card, task, tracker)


def windows_of_scene(scene: Scene, card: Card, task: Task, tracker: Tracker) -> Windows:
    """The windows of one scene."""
    local = LocalFrame.of(scene)
    feed = make_feed(scene, local, task, card)
    labels = SceneLabels(scene, card, local, feed)
    tracker.reset(task)
    parts = [_no_windows(task)]
    seen = deque[Observation](maxlen=task.past)
    road = list[Observation]()
    for t in range(scene.frames):
        if task.after_hole(observation := feed.observe(t)):
            seen.clear()
        seen.append(observation)
        road.append({name: observation[name] for name in LANES if name in observation})
        tracks = tracker.step(seen[-1])
        if not np.isfinite(tracks.box).all():
            raise MtpBenchError(
                f"scene {scene.name!r}, frame {t}: the tracker gave a box that is not finite"
            )
        frame_windows, _ = windows_of(Frame(t, tracks, tuple(seen)), task.past)
        parts.append(_labelled(frame_windows, labels.of(t, frame_windows), t))
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    box, velocity, score = (
        _single_precision(values) for values in (feed.box, feed.velocity, feed.score)
    )
    piece = pieces(scene, card)
    before = np.arange(scene.frames) - np.searchsorted(piece, piece)
    around = Surroundings(
        feed.start, box, velocity, feed.class_id, score, before, lanes_of(road)
    )
    scene_number = np.zeros(len(rows["frame"]), dtype=np.int64)
    names = (scene.name,)
    return Windows(
        **rows,
        scene=scene_number,
        moment=rows["frame"],
        names=names,
        own_names=names,
        seen=around,
        task=task,
        envs=(task.env_id,),
    )


def _labelled(
    frame_windows: TrackWindows, labels: TrackLabels, t: int
) -> dict[str, np.ndarray]:
    """The windows of frame ``t`` whose object is known, or known to be none, with their labels."""
    known = labels.object_id != UNKNOWN
    columns = {
        f.name: getattr(frame_windows, f.name) for f in fields(TrackWindows)
    } | labels._asdict()
    rows = {name: _single_precision(value[known]) for name, value in columns.items()}
    return {**rows, "frame": np.full(known.sum(), t)}


def _no_windows(task: Task) -> dict[str, np.ndarray]:
    """Columns without rows, for a scene without windows."""
    no_tracks = Tracks.of_one_hypothesis(
        np.zeros(0, dtype=np.int64), np.zeros((0, 7)), np.zeros(0, dtype=np.int64)
    )
    empty, _ = windows_of(Frame(0, no_tracks, ({},)), task.past)
    ids = np.zeros(0, dtype=np.int64)
    future = np.zeros((0, task.future, 2))
    return _labelled(
        empty,
        TrackLabels(ids, np.zeros((0, 2)), future, future[:, :, 0] > 0, ids > 0),
        0,
    )


def _single_precision(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32) if values.dtype.kind == "f" else np.asarray(values)
