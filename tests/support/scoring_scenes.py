"""Cards, scenes and rollouts written as small literals, and random ones, for the tests of the scorer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.cards import Card, parse_card
from mtp_bench.core import Detections, Rollout, Scene, Truth, joined, starts_of
from mtp_bench.core.geometry import transform_boxes

CAR, WALKER = 0, 1
Array = NDArray[Any]


def make_card(past: int = 2, future: int = 3, samples: int = 4, measure: str = "center_distance") -> Card:
    """Two classes; gates 2 m and 1 m (or IoU .5), miss errors 10 m and 4 m; 10 Hz."""
    gate = {"car": 2.0, "pedestrian": 1.0} if measure == "center_distance" else 0.5
    task = {
        "rate": 10.0, "past": past, "future": future, "samples": samples, "classes": ["car", "pedestrian"],
        "miss_error": {"car": 10.0, "pedestrian": 4.0}, "forecast_gate": {"car": 2.0, "pedestrian": 1.0},
        "event_gate": {"measure": measure, "threshold": gate},
    }  # fmt: skip
    size = {"detections": 9, "tracks": 9, "objects": 9, "hypotheses": 3}
    return parse_card({"id": "MTP-Test-v0", "summary": "test", "source": {"name": "kitti"}, "task": task, "size": size})


@dataclass(frozen=True)
class Thing:
    """A true object, a track or a forecast object in one frame."""

    id: int
    x: float
    y: float
    class_id: int = CAR
    neutral: bool = False
    eligible: bool = True
    hypotheses: tuple[int, ...] = (0,)
    forecast: Any = None  # [K, T, 2] absolute x y
    log_weight: Any = None  # [K]
    confidence: float = 1.0


def at(id: int, xy: Any, **more: Any) -> Thing:
    return Thing(id, float(xy[0]), float(xy[1]), **more)


def make_scene(frames: Sequence[Sequence[Thing]], name: str = "s", truth_complete: bool = True) -> Scene:
    """A scene at 10 Hz with the ego at rest in the origin."""
    rows = [thing for frame in frames for thing in frame]
    count = len(frames)
    start = _starts(frames)
    nothing = np.zeros((0, 7))
    truth = Truth(
        start=start, box=_boxes(rows), velocity=np.full((len(rows), 2), np.nan),
        class_id=np.array([r.class_id for r in rows], dtype=np.int64),
        object_id=np.array([r.id for r in rows], dtype=np.int64),
        eligible=np.array([r.eligible for r in rows], dtype=bool),
        neutral=np.array([r.neutral for r in rows], dtype=bool),
    )  # fmt: skip
    detections = Detections(np.zeros(count + 1, dtype=int), nothing, nothing[:, :2], np.zeros(0, int), np.zeros(0))
    return Scene(name, 0.1 * np.arange(count), np.zeros((count, 4)), truth, detections, truth_complete=truth_complete)


def with_detections(scene: Scene, frames: Sequence[Sequence[Thing]]) -> Scene:
    seen = make_scene(frames).truth
    score = np.ones(len(seen.box))
    return replace(scene, detections=Detections(seen.start, seen.box, seen.velocity, seen.class_id, score))


def make_rollout(
    tracks: Sequence[Sequence[Thing]], objects: Sequence[Sequence[Thing]] = (), log_weight: Any = None, name: str = "s",
    samples: int = 1, future: int = 3, hypotheses: int = 1,
) -> Rollout:  # fmt: skip
    """A rollout; ``log_weight`` [F, H], all hypotheses alike by default."""
    frames = max(len(tracks), len(objects))
    tracks, objects = _padded(tracks, frames), _padded(objects, frames)
    rows = [thing for frame in tracks for thing in frame]
    seen = [thing for frame in objects for thing in frame]
    member = np.zeros((len(rows), hypotheses), dtype=bool)
    for i, row in enumerate(rows):
        member[i, list(row.hypotheses)] = True
    box = _boxes(seen)
    forecast = np.zeros((len(seen), samples, future, 2), dtype=np.int16)
    weight = np.full((len(seen), samples), -np.log(samples))
    for i, thing in enumerate(seen):
        if thing.forecast is not None:
            forecast[i] = np.round(100 * (np.asarray(thing.forecast) - box[i, :2]))
        if thing.log_weight is not None:
            weight[i] = thing.log_weight
    given = np.full((frames, hypotheses), -np.log(hypotheses)) if log_weight is None else np.array(log_weight, float)
    return Rollout(
        scene=name, track_start=_starts(tracks), track_id=np.array([r.id for r in rows], dtype=np.int64),
        track_box=_boxes(rows), track_class=np.array([r.class_id for r in rows], dtype=np.int64), member=member,
        hypothesis_log_weight=given, hypothesis_parent=np.full(given.shape, -1), object_start=_starts(objects),
        object_box=box, object_class=np.array([r.class_id for r in seen], dtype=np.int64),
        object_confidence=np.array([r.confidence for r in seen], dtype=np.float32), forecast=forecast,
        forecast_log_weight=weight, invalid=np.zeros((frames, 3), dtype=np.int64),
        malformed=np.zeros((frames, 3), dtype=np.int64), dropped=np.zeros(frames, dtype=np.int64),
        seconds=np.full(frames, 0.01),
    )  # fmt: skip


def random_case(
    seed: int, frames: int = 12, objects: int = 6, hypotheses: int = 3, name: str = "s", apart: float = 0.0
) -> tuple[Scene, Rollout]:
    """A crowd with gaps, and a rollout with misses, switches, false forecasts and absent samples (4, 3 frames).

    Confidences are eighths, so many are equal. ``apart``: metres by which every object is away from the next.
    """
    rng = np.random.default_rng(seed)
    where = rng.uniform(-8, 8, (objects, 2)) + rng.normal(0, 0.4, (objects, 2)) * np.arange(frames)[:, None, None]
    where[..., 0] += apart * np.arange(objects)
    kind = rng.integers(0, 2, objects)
    truth: list[list[Thing]] = []
    tracks: list[list[Thing]] = []
    seen: list[list[Thing]] = []
    for t in range(frames):
        there = rng.random(objects) > 0.05
        truth.append([
            at(i, where[t, i], class_id=int(kind[i]), neutral=i == 5, eligible=i != 4)
            for i in range(objects) if there[i]
        ])  # fmt: skip
        tracks.append([])
        for i in range(objects):
            for h in range(hypotheses):
                if rng.random() > 0.15:
                    xy = where[t, i] + rng.normal(0, 0.4, 2)
                    name_of = 10 * i + int(rng.random() < 0.2)
                    tracks[-1].append(at(name_of, xy, class_id=int(kind[i]), hypotheses=(h,)))
        seen.append([])
        for i in range(objects):
            if rng.random() > 0.2:
                xy = np.round(where[t, i] + rng.normal(0, 0.5, 2), 6)
                path = xy + rng.normal(0, 0.5, (4, 3, 2)).cumsum(axis=1)
                weight = np.where(rng.random(4) < 0.2, -np.inf, rng.normal(0, 1, 4))
                seen[-1].append(at(i, xy, class_id=int(kind[i]), forecast=path, log_weight=weight))
        if rng.random() < 0.3:
            xy = rng.uniform(-8, 8, 2)
            seen[-1].append(at(99, xy, forecast=np.tile(xy, (4, 3, 1))))
    weight = np.log(rng.dirichlet(np.ones(hypotheses), frames))
    rollout = make_rollout(tracks, seen, weight, name, 4, 3, hypotheses)
    confidence = rng.integers(0, 9, len(rollout.object_box)) / 8
    return make_scene(truth, name), replace(rollout, object_confidence=confidence.astype(np.float32))


def moved(scene: Scene, rollout: Rollout, yaw: float, shift: tuple[float, float, float]) -> tuple[Scene, Rollout]:
    """The same world turned about z and shifted; forecasts stay exact for turns by right angles."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    ego = transform_boxes(np.concatenate([scene.ego, np.ones((len(scene.ego), 3))], axis=1), yaw, shift)[:, :4]
    truth = replace(scene.truth, box=transform_boxes(scene.truth.box, yaw, shift))
    seen = replace(scene.detections, box=transform_boxes(scene.detections.box, yaw, shift))
    return replace(scene, ego=ego, truth=truth, detections=seen), replace(
        rollout,
        track_box=transform_boxes(rollout.track_box, yaw, shift),
        object_box=transform_boxes(rollout.object_box, yaw, shift),
        forecast=np.round(rollout.forecast @ turn.T).astype(np.int16),
    )


def take_tracks(rollout: Rollout, rows: Array) -> Rollout:
    """The tracks in another order within their frames, or some of them; ``rows`` indexes the old ones."""
    frame = rollout.tracks.frame_of_rows[rows]
    return replace(
        rollout, track_start=np.searchsorted(frame, np.arange(rollout.frames + 1)), track_id=rollout.track_id[rows],
        track_box=rollout.track_box[rows], track_class=rollout.track_class[rows], member=rollout.member[rows],
    )  # fmt: skip


def take_objects(rollout: Rollout, rows: Array) -> Rollout:
    """The forecast objects of ``rows``, which are sorted by frame and may name a row twice."""
    frame = rollout.objects.frame_of_rows[rows]
    return replace(
        rollout, object_start=np.searchsorted(frame, np.arange(rollout.frames + 1)),
        object_box=rollout.object_box[rows], object_class=rollout.object_class[rows],
        object_confidence=rollout.object_confidence[rows], forecast=rollout.forecast[rows],
        forecast_log_weight=rollout.forecast_log_weight[rows],
    )  # fmt: skip


def end_to_end(scenes: Sequence[Scene], step: float) -> Scene:
    """One scene of several: the first frame of each comes ``step`` s after the last of the one before."""
    first, *others = scenes
    time = first.time
    for scene in others:
        time = np.concatenate([time, time[-1] + step + scene.time - scene.time[0]])
    truth, detections = (_rows_of_all([getattr(scene, name) for scene in scenes]) for name in ("truth", "detections"))
    ego = np.concatenate([scene.ego for scene in scenes])
    return replace(first, time=time, ego=ego, truth=truth, detections=detections)


def answers_end_to_end(rollouts: Sequence[Rollout]) -> Rollout:
    names = [column.name for column in fields(Rollout) if column.name not in ("scene", "drive")]
    whole: dict[str, Any] = {name: np.concatenate([getattr(rollout, name) for rollout in rollouts]) for name in names}
    for name in ("track", "object"):
        whole[f"{name}_start"] = starts_of(np.concatenate([np.diff(getattr(r, f"{name}_start")) for r in rollouts]))
    return replace(rollouts[0], **whole)


def _rows_of_all(tables: Sequence[Any]) -> Any:
    return replace(joined(tables), start=starts_of(np.concatenate([table.counts for table in tables])))


def _boxes(things: Iterable[Thing]) -> Array:
    return np.array([[t.x, t.y, 0.0, 0.0, 4.0, 2.0, 1.5] for t in things], dtype=np.float64).reshape(-1, 7)


def _starts(frames: Sequence[Sequence[Thing]]) -> Array:
    return starts_of([len(frame) for frame in frames])


def _padded(frames: Sequence[Sequence[Thing]], count: int) -> list[Sequence[Thing]]:
    return [*frames, *[()] * (count - len(frames))]


def line(ids: Sequence[int | None], y: float = 0.0, **more: Any) -> list[list[Thing]]:
    """A thing that moves 1 m per frame along x, under another id in every frame; None: it is not there."""
    return [[] if i is None else [Thing(i, float(t), y, **more)] for t, i in enumerate(ids)]
