"""Faults that are planted into healthy scenes, each at three strengths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtp_bench.core import (
    Bools,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    rotate,
    starts_of_sorted,
    wrap_angle,
)

Draw = np.random.Generator
# faults of a few objects, frames or directions
PARTIAL = (
    "detector hangs",
    "padded with zeros",
    "padded with the last position",
    "truth jumps",
    "ids exchanged",
    "detections jump",
    "everything jumps",
    "ego jumps",
    "region without labels",
    "sensor late",
    "sensor off its place",
)
Planted = Callable[[Scene, float, Draw], Scene]


@dataclass(frozen=True)
class Fault:
    """A kind of fault; ``expected``: kinds of doubts that name it rightly."""

    name: str
    expected: tuple[str, ...]
    strengths: tuple[float, float, float]
    plant: Planted
    needs: str = ""  # "ego": the ego moves; "cars", "headings" (several), "classes" (two), "scores": the scene has them

    @property
    def is_whole(self) -> bool:
        """True for a fault of the whole log."""
        return self.name not in PARTIAL


def with_rows(rows: Detections, frame: Ints, **columns: Any) -> Detections:
    """Return rows in other frames; frames outside of the scene are left out."""
    frames = len(rows.start) - 1
    changed: Detections = replace(rows, **columns)
    kept = np.flatnonzero((frame >= 0) & (frame < frames))
    order = kept[np.argsort(frame[kept], kind="stable")]
    changed = replace(
        changed,
        **{
            name: values[order]
            for name, values in vars(changed).items()
            if name != "start"
        },
    )
    return replace(changed, start=starts_of_sorted(frame[order], frames))


def detected(scene: Scene, box: Floats) -> Scene:
    box[:, 3] = wrap_angle(box[:, 3])
    return replace(scene, detections=replace(scene.detections, box=box))


def true(scene: Scene, box: Floats) -> Scene:
    return replace(scene, truth=replace(scene.truth, box=box))


def pose_of(scene: Scene, rows: Truth | Detections) -> Floats:
    return scene.ego[rows.frame_of_rows]


def seen_from_ego(box: Floats, pose: Floats) -> Floats:
    out = box.copy()
    out[:, :2] = rotate(box[:, :2] - pose[:, :2], -pose[:, 3])
    out[:, 3] = box[:, 3] - pose[:, 3]
    return out


def back_from_ego(box: Floats, pose: Floats) -> Floats:
    out = box.copy()
    out[:, :2] = rotate(box[:, :2], pose[:, 3]) + pose[:, :2]
    out[:, 3] = box[:, 3] + pose[:, 3]
    return out


def shifted(scene: Scene, frames: float, draw: Draw) -> Scene:
    """Detections that show the world of some frames before."""
    rows = scene.detections
    whole = int(np.ceil(frames))
    part = whole - frames  # of a frame that they are early after the whole frames
    box = rows.box.copy()
    velocity = np.nan_to_num(nearest_velocity(scene, rows))
    dt = float(np.median(np.diff(scene.time)))
    box[:, :2] += part * dt * velocity
    return replace(
        scene, detections=with_rows(rows, rows.frame_of_rows + whole, box=box)
    )


def nearest_velocity(scene: Scene, rows: Detections) -> Floats:
    """Velocities of the nearest true boxes within 4 m, else 0."""
    truth = scene.truth
    velocity = np.zeros((len(rows.box), 2))
    moved = track_velocity(scene)
    for t in range(scene.frames):
        a, b = rows.rows(t), truth.rows(t)
        if a.start == a.stop or b.start == b.stop:
            continue
        away = rows.box[a, None, :2] - truth.box[None, b, :2]
        distance = np.hypot(away[..., 0], away[..., 1])
        near = distance.argmin(axis=1)
        ok = distance.min(axis=1) < 4.0
        velocity[a][ok] = moved[b][near[ok]]
    return velocity


def track_velocity(scene: Scene) -> Floats:
    truth = scene.truth
    frame = truth.frame_of_rows
    order = np.lexsort((frame, truth.object_id))
    velocity = np.zeros((len(order), 2))
    xy, time, number = (
        truth.box[order, :2],
        scene.time[frame[order]],
        truth.object_id[order],
    )
    step = np.diff(xy, axis=0) / np.maximum(np.diff(time), 1e-9)[:, None]
    same = np.diff(number) == 0
    ahead = np.vstack([np.where(same[:, None], step, 0.0), np.zeros((1, 2))])
    last = np.append(~same, True)
    before = np.vstack([np.zeros((1, 2)), ahead[:-1]])
    ahead[last] = before[last]
    velocity[order] = ahead
    return velocity


def early(scene: Scene, frames: float, draw: Draw) -> Scene:
    rows = scene.detections
    whole = int(np.ceil(frames))
    box = rows.box.copy()
    dt = float(np.median(np.diff(scene.time)))
    box[:, :2] -= (whole - frames) * dt * np.nan_to_num(nearest_velocity(scene, rows))
    return replace(
        scene, detections=with_rows(rows, rows.frame_of_rows - whole, box=box)
    )


def offset(scene: Scene, metres: float, draw: Draw) -> Scene:
    angle = draw.uniform(0, 2 * np.pi)
    move = metres * np.array([np.cos(angle), np.sin(angle)])
    box = scene.detections.box.copy()
    box[:, :2] += rotate(
        np.tile(move, (len(box), 1)), pose_of(scene, scene.detections)[:, 3]
    )
    return detected(scene, box)


def turned(scene: Scene, degrees: float, draw: Draw) -> Scene:
    pose = pose_of(scene, scene.detections)
    seen = seen_from_ego(scene.detections.box, pose)
    angle = np.radians(degrees) * draw.choice([-1, 1])
    seen[:, :2] = rotate(seen[:, :2], angle)
    seen[:, 3] += angle
    return detected(scene, back_from_ego(seen, pose))


def scaled(scene: Scene, percent: float, draw: Draw) -> Scene:
    pose = pose_of(scene, scene.detections)
    seen = seen_from_ego(scene.detections.box, pose)
    seen[:, :2] *= 1 + draw.choice([-1, 1]) * percent / 100
    return detected(scene, back_from_ego(seen, pose))


def by_point(along: float, across: float) -> Planted:
    def plant(scene: Scene, strength: float, draw: Draw) -> Scene:
        box = scene.detections.box.copy()
        move = np.stack(
            [along * strength * box[:, 4], across * strength * box[:, 5]], axis=1
        )
        box[:, :2] += rotate(move, box[:, 3])
        return detected(scene, box)

    return plant


def some_frames(scene: Scene, percent: float, draw: Draw) -> Bools:
    return draw.random(scene.frames) < percent / 100


def mirrored(scene: Scene, percent: float, draw: Draw) -> Scene:
    rows = scene.detections
    pose = pose_of(scene, rows)
    seen = seen_from_ego(rows.box, pose)
    seen[:, 1] *= -1
    seen[:, 3] *= -1
    chosen = some_frames(scene, percent, draw)[rows.frame_of_rows]
    return detected(
        scene, np.where(chosen[:, None], back_from_ego(seen, pose), rows.box)
    )


def in_ego_frame(scene: Scene, _: float, draw: Draw) -> Scene:
    rows = scene.detections
    return detected(scene, seen_from_ego(rows.box, pose_of(scene, rows)))


def truth_in_ego_frame(scene: Scene, _: float, draw: Draw) -> Scene:
    return true(scene, seen_from_ego(scene.truth.box, pose_of(scene, scene.truth)))


def exchanged_axes(scene: Scene, _: float, draw: Draw) -> Scene:
    box = scene.detections.box.copy()
    box[:, :2] = box[:, 1::-1]
    box[:, 3] = np.pi / 2 - box[:, 3]
    return detected(scene, box)


def turned_square(scene: Scene, _: float, draw: Draw) -> Scene:
    return turned(scene, float(draw.choice([90, 180])), draw)


def in_feet(scene: Scene, _: float, draw: Draw) -> Scene:
    box = scene.detections.box.copy()
    box[:, :3] /= 0.3048
    box[:, 4:] /= 0.3048
    return detected(scene, box)


def late_ego(scene: Scene, frames: float, draw: Draw) -> Scene:
    """Detections put into the world by the pose of some frames before."""
    rows = scene.detections
    frame = np.arange(scene.frames, dtype=float)
    yaw = np.unwrap(scene.ego[:, 3])
    then = np.column_stack(
        [
            np.interp(frame - frames, frame, column)
            for column in (*scene.ego[:, :3].T, yaw)
        ]
    )
    seen = seen_from_ego(rows.box, pose_of(scene, rows))
    return detected(scene, back_from_ego(seen, then[rows.frame_of_rows]))


FITTED = (
    Fault("late", ("late",), (0.5, 1, 3), shifted),
    Fault("early", ("late",), (0.5, 1, 3), early),
    Fault("pose late", ("pose_late",), (0.2, 0.5, 1), late_ego, "ego"),
    Fault("mirrored", ("mirrored",), (30, 60, 100), mirrored),
    Fault("offset", ("offset", "world_offset"), (0.3, 1, 3), offset),
    Fault("turn", ("turn",), (0.5, 2, 8), turned),
    Fault("scale", ("scale",), (1, 3, 10), scaled),
    Fault("box corner", ("box_point",), (0.2, 0.5, 1), by_point(0.5, 0.5), "headings"),
    Fault("rear axle", ("box_point",), (0.2, 0.5, 1), by_point(-0.35, 0), "headings"),
    Fault(
        "detections in the ego frame", ("ego_frame",), (1, 1, 1), in_ego_frame, "ego"
    ),
    Fault(
        "truth in the ego frame",
        ("truth_ego_frame",),
        (1, 1, 1),
        truth_in_ego_frame,
        "ego",
    ),
    Fault("axes exchanged", ("axes",), (1, 1, 1), exchanged_axes),
    Fault("turned by 90", ("axes",), (1, 1, 1), turned_square),
    Fault("detections in feet", ("units", "detections_sizes"), (1, 1, 1), in_feet),
)


def in_rows(share: float, rows: Truth | Detections, draw: Draw) -> Bools:
    return draw.random(len(rows.box)) < share


def heading(part: str, angle: float) -> Planted:
    def plant(scene: Scene, percent: float, draw: Draw) -> Scene:
        rows = getattr(scene, part)
        box = rows.box.copy()
        box[in_rows(percent / 100, rows, draw), 3] += angle
        return replace(scene, **{part: replace(rows, box=box)})

    return plant


def resized(part: str, factor: float) -> Planted:
    def plant(scene: Scene, _: float, draw: Draw) -> Scene:
        rows = getattr(scene, part)
        box = rows.box.copy()
        box[:, 4:] *= factor
        return replace(scene, **{part: replace(rows, box=box)})

    return plant


def all_in(factor: float) -> Planted:
    def plant(scene: Scene, _: float, draw: Draw) -> Scene:
        for part in ("truth", "detections"):
            rows = getattr(scene, part)
            box = rows.box.copy()
            box[:, :3] *= factor
            box[:, 4:] *= factor
            scene = replace(scene, **{part: replace(rows, box=box)})
        return scene

    return plant


def sides(part: str) -> Planted:
    def plant(scene: Scene, _: float, draw: Draw) -> Scene:
        rows = getattr(scene, part)
        box = rows.box.copy()
        box[:, 4:6] = box[:, 5:3:-1]
        return replace(scene, **{part: replace(rows, box=box)})

    return plant


def degrees(part: str) -> Planted:
    def plant(scene: Scene, _: float, draw: Draw) -> Scene:
        rows = getattr(scene, part)
        box = rows.box.copy()
        box[:, 3] = np.degrees(box[:, 3])
        return replace(scene, **{part: replace(rows, box=box)})

    return plant


def wrapped_degrees(scene: Scene, _: float, draw: Draw) -> Scene:
    box = scene.detections.box.copy()
    box[:, 3] = np.remainder(np.degrees(box[:, 3]) + np.pi, 2 * np.pi) - np.pi
    return detected(scene, box)


def by_bottom(scene: Scene, _: float, draw: Draw) -> Scene:
    box = scene.detections.box.copy()
    box[:, 2] -= box[:, 6] / 2
    return detected(scene, box)


def jump_of_detections(scene: Scene, metres: float, draw: Draw) -> Scene:
    rows = scene.detections
    angle = draw.uniform(0, 2 * np.pi)
    start = draw.uniform(0.3, 0.7) * scene.frames
    box = rows.box.copy()
    box[rows.frame_of_rows >= start, :2] += metres * np.array(
        [np.cos(angle), np.sin(angle)]
    )
    return detected(scene, box)


def jump_of_all(scene: Scene, metres: float, draw: Draw) -> Scene:
    angle = draw.uniform(0, 2 * np.pi)
    start = int(draw.uniform(0.3, 0.7) * scene.frames)
    move = metres * np.array([np.cos(angle), np.sin(angle)])
    ego = scene.ego.copy()
    ego[start:, :2] += move
    for part in ("truth", "detections"):
        rows = getattr(scene, part)
        box = rows.box.copy()
        box[rows.frame_of_rows >= start, :2] += move
        scene = replace(scene, **{part: replace(rows, box=box)})
    return replace(scene, ego=ego)


def jump_of_ego(scene: Scene, metres: float, draw: Draw) -> Scene:
    angle = draw.uniform(0, 2 * np.pi)
    ego = scene.ego.copy()
    ego[int(draw.uniform(0.3, 0.7) * scene.frames) :, :2] += metres * np.array(
        [np.cos(angle), np.sin(angle)]
    )
    return replace(scene, ego=ego)


def heading_of_ego(scene: Scene, degrees: float, draw: Draw) -> Scene:
    ego = scene.ego.copy()
    ego[:, 3] += np.radians(degrees)
    return replace(scene, ego=ego)


def both_in_ego_frame(scene: Scene, strength: float, draw: Draw) -> Scene:
    return truth_in_ego_frame(in_ego_frame(scene, strength, draw), strength, draw)


def two_classes(scene: Scene) -> tuple[int, int]:
    """The two most frequent classes of the truth."""
    count = np.bincount(scene.truth.class_id)
    most = np.argsort(-count, kind="stable")
    return int(most[0]), int(most[1])


def exchanged_classes(scene: Scene, _: float, draw: Draw) -> Scene:
    a, b = two_classes(scene)
    class_id = scene.detections.class_id.copy()
    class_id[scene.detections.class_id == a] = b
    class_id[scene.detections.class_id == b] = a
    return replace(scene, detections=replace(scene.detections, class_id=class_id))


def renamed_class(scene: Scene, percent: float, draw: Draw) -> Scene:
    a, b = two_classes(scene)
    rows = scene.detections
    class_id = rows.class_id.copy()
    class_id[(rows.class_id == a) & in_rows(percent / 100, rows, draw)] = b
    return replace(scene, detections=replace(rows, class_id=class_id))


def inverted_scores(scene: Scene, _: float, draw: Draw) -> Scene:
    rows = scene.detections
    return replace(
        scene,
        detections=replace(
            rows, score=rows.score.max() + rows.score.min() - rows.score
        ),
    )


def shuffled_scores(scene: Scene, _: float, draw: Draw) -> Scene:
    rows = scene.detections
    return replace(scene, detections=replace(rows, score=draw.permutation(rows.score)))


def doubled(scene: Scene, percent: float, draw: Draw) -> Scene:
    rows = scene.detections
    again = np.flatnonzero(in_rows(percent / 100, rows, draw))
    frame = rows.frame_of_rows
    columns = {
        n: np.concatenate([v, v[again]]) for n, v in vars(rows).items() if n != "start"
    }
    return replace(
        scene,
        detections=with_rows(rows, np.concatenate([frame, frame[again]]), **columns),
    )


def hanging(scene: Scene, frames: float, draw: Draw) -> Scene:
    rows = scene.detections
    first = int(draw.integers(1, max(2, scene.frames - int(frames))))
    shown = np.arange(scene.frames)
    shown[first : first + int(frames)] = first - 1
    parts = [np.arange(rows.start[t], rows.start[t + 1]) for t in shown]
    frame = np.repeat(np.arange(scene.frames), [len(part) for part in parts])
    columns = {
        n: v[np.concatenate(parts)] for n, v in vars(rows).items() if n != "start"
    }
    return replace(scene, detections=with_rows(rows, frame, **columns))


def an_object(scene: Scene, draw: Draw, moving: bool = False) -> int:
    """An object with many rows, or one of the fastest."""
    truth = scene.truth
    ids, counts = np.unique(truth.object_id, return_counts=True)
    long = ids[counts >= min(12, counts.max())]
    if moving:
        speed = np.hypot(*track_velocity(scene).T)
        fast = [np.median(speed[truth.object_id == number]) for number in long]
        long = long[np.argsort(fast)[-3:]]
    return int(draw.choice(long))


def padded(last: bool) -> Planted:
    def plant(scene: Scene, frames: float, draw: Draw) -> Scene:
        truth = scene.truth
        number = an_object(scene, draw, moving=True)
        rows = np.flatnonzero(truth.object_id == number)
        kept = rows[: max(4, len(rows) - int(frames))]
        gone = rows[len(kept) :]
        box = truth.box.copy()
        box[gone, :2] = box[kept[-1], :2] if last else 0.0
        return true(scene, box)

    return plant


def jump_of_object(scene: Scene, metres: float, draw: Draw) -> Scene:
    truth = scene.truth
    rows = np.flatnonzero(truth.object_id == an_object(scene, draw))
    angle = draw.uniform(0, 2 * np.pi)
    box = truth.box.copy()
    row = (
        rows[draw.integers(2, len(rows) - 2)] if len(rows) > 5 else rows[len(rows) // 2]
    )
    box[row, :2] += metres * np.array([np.cos(angle), np.sin(angle)])
    return true(scene, box)


def jitter(scene: Scene, metres: float, draw: Draw) -> Scene:
    box = scene.truth.box.copy()
    box[:, :2] += draw.normal(0, metres / np.sqrt(2), (len(box), 2))
    return true(scene, box)


def exchanged_ids(scene: Scene, _: float, draw: Draw) -> Scene:
    truth = scene.truth
    frame = truth.frame_of_rows
    for _ in range(200):
        t = int(draw.integers(3, scene.frames - 3))
        a = an_object(scene, draw)
        here = np.flatnonzero((frame == t) & (truth.object_id != a))
        own = np.flatnonzero((frame == t) & (truth.object_id == a))
        if not len(own) or not len(here):
            continue
        same = here[truth.class_id[here] == truth.class_id[own[0]]]
        away = np.hypot(*(truth.box[same, :2] - truth.box[own[0], :2]).T)
        able = same[(away > 4) & (away < 30)]
        if not len(able):
            continue
        b = int(truth.object_id[draw.choice(able)])
        around = [
            ((truth.object_id == n) & (np.abs(frame - t) <= 2)).sum() for n in (a, b)
        ]
        if min(around) < 5:
            continue
        ids = truth.object_id.copy()
        later = frame >= t
        ids[later & (truth.object_id == a)] = b
        ids[later & (truth.object_id == b)] = a
        return replace(scene, truth=replace(truth, object_id=ids))
    return scene


def broken_ids(scene: Scene, every: float, draw: Draw) -> Scene:
    truth = scene.truth
    _, number = np.unique(truth.object_id, return_inverse=True)
    part = (truth.frame_of_rows + number * 3) // int(every)
    _, ids = np.unique(number * 100_000 + part, return_inverse=True)
    return replace(scene, truth=replace(truth, object_id=ids), object_names={})


def sparse(scene: Scene, every: float, draw: Draw) -> Scene:
    kept = scene.truth.frame_of_rows % int(every) == 0
    return replace(scene, truth=scene.truth.select(kept))


def unlabelled(scene: Scene, degrees: float, draw: Draw) -> Scene:
    truth = scene.truth
    seen = seen_from_ego(truth.box, pose_of(scene, truth))
    middle = draw.uniform(-np.pi, np.pi)
    away = np.abs(
        np.remainder(np.arctan2(seen[:, 1], seen[:, 0]) - middle + np.pi, 2 * np.pi)
        - np.pi
    )
    kept = away > np.radians(degrees) / 2
    return replace(scene, truth=truth.select(kept)) if kept.any() else scene


def in_sector(scene: Scene, degrees: float, draw: Draw) -> Bools:
    rows = scene.detections
    seen = seen_from_ego(rows.box, pose_of(scene, rows))
    middle = draw.uniform(-np.pi, np.pi)
    away = np.abs(
        np.remainder(np.arctan2(seen[:, 1], seen[:, 0]) - middle + np.pi, 2 * np.pi)
        - np.pi
    )
    return np.asarray(away < np.radians(degrees) / 2)


def late_sensor(scene: Scene, degrees: float, draw: Draw) -> Scene:
    rows = scene.detections
    late = in_sector(scene, degrees, draw)
    return replace(scene, detections=with_rows(rows, rows.frame_of_rows + late))


def moved_sensor(scene: Scene, metres: float, draw: Draw) -> Scene:
    rows = scene.detections
    inside = in_sector(scene, 90.0, draw)
    angle = draw.uniform(0, 2 * np.pi)
    move = metres * np.array([np.cos(angle), np.sin(angle)])
    box = rows.box.copy()
    box[inside, :2] += rotate(
        np.tile(move, (int(inside.sum()), 1)), pose_of(scene, rows)[inside, 3]
    )
    return detected(scene, box)


def other_rate(factor: float) -> Planted:
    def plant(scene: Scene, _: float, draw: Draw) -> Scene:
        for part in ("truth", "detections"):
            rows = getattr(scene, part)
            kept = rows.frame_of_rows % round(factor) == 0
            frame = rows.frame_of_rows[kept] // round(factor)
            chosen = rows.select(kept)
            frames = -(-scene.frames // round(factor))
            start = starts_of_sorted(frame, frames)
            scene = replace(scene, **{part: replace(chosen, start=start)})
        frames = -(-scene.frames // round(factor))
        return replace(scene, time=scene.time[:frames], ego=scene.ego[:: round(factor)])

    return plant


def other_clock(scene: Scene, factor: float, draw: Draw) -> Scene:
    return replace(scene, time=scene.time * factor)


ALONE = (
    Fault("bottom for centre", ("bottom",), (1, 1, 1), by_bottom),
    Fault("detections jump", ("later_offset",), (0.3, 1, 5), jump_of_detections),
    Fault("everything jumps", ("all_jump", "ego_jump"), (0.5, 2, 10), jump_of_all),
    Fault("ego jumps", ("ego_jump",), (0.5, 2, 10), jump_of_ego, "ego"),
    Fault("heading of the ego", ("ego_heading",), (5, 90, 180), heading_of_ego, "ego"),
    Fault(
        "both in the ego frame", ("all_ego_frame",), (1, 1, 1), both_in_ego_frame, "ego"
    ),
    Fault(
        "detected sizes in feet",
        ("detections_sizes",),
        (1, 1, 1),
        resized("detections", 1 / 0.3048),
    ),
    Fault("true sizes in cm", ("truth_sizes",), (1, 1, 1), resized("truth", 100.0)),
    Fault(
        "all in feet",
        ("truth_sizes", "detections_sizes"),
        (1, 1, 1),
        all_in(1 / 0.3048),
    ),
    Fault("true degrees", ("truth_degrees",), (1, 1, 1), degrees("truth"), "headings"),
    Fault(
        "detected degrees",
        ("detections_degrees",),
        (1, 1, 1),
        degrees("detections"),
        "cars",
    ),
    Fault(
        "degrees wrapped",
        ("detection_across", "detection_backwards"),
        (1, 1, 1),
        wrapped_degrees,
        "cars",
    ),
    Fault(
        "detected heading turned 180",
        ("detection_backwards",),
        (10, 30, 100),
        heading("detections", np.pi),
        "cars",
    ),
    Fault(
        "detected heading turned 90",
        ("detection_across",),
        (10, 30, 100),
        heading("detections", np.pi / 2),
        "cars",
    ),
    Fault(
        "true heading turned 180",
        ("truth_backwards",),
        (10, 30, 100),
        heading("truth", np.pi),
        "cars",
    ),
    Fault(
        "true heading turned 90",
        ("truth_across",),
        (10, 30, 100),
        heading("truth", np.pi / 2),
        "cars",
    ),
    Fault(
        "true l and w exchanged", ("truth_sides",), (1, 1, 1), sides("truth"), "cars"
    ),
    Fault(
        "detected l and w exchanged",
        ("detections_sides",),
        (1, 1, 1),
        sides("detections"),
        "cars",
    ),
    Fault(
        "classes exchanged",
        ("classes_exchanged",),
        (1, 1, 1),
        exchanged_classes,
        "classes",
    ),
    Fault(
        "class renamed",
        ("class_renamed", "classes_exchanged"),
        (30, 60, 100),
        renamed_class,
        "classes",
    ),
    Fault("scores inverted", ("scores_order",), (1, 1, 1), inverted_scores, "scores"),
    Fault("scores shuffled", ("scores_order",), (1, 1, 1), shuffled_scores, "scores"),
    Fault("detections doubled", ("doubled",), (10, 50, 100), doubled),
    Fault("detector hangs", ("hangs",), (2, 5, 15), hanging),
    Fault("padded with zeros", ("padded_zeros",), (5, 10, 20), padded(last=False)),
    Fault(
        "padded with the last position",
        ("padded_last",),
        (5, 10, 20),
        padded(last=True),
    ),
    Fault("truth jumps", ("truth_jump",), (2, 5, 20), jump_of_object),
    Fault("truth jitters", ("truth_jitter",), (0.3, 1, 3), jitter),
    Fault("ids exchanged", ("ids_exchanged",), (1, 1, 1), exchanged_ids),
    Fault("ids broken", ("ids_broken",), (20, 10, 5), broken_ids),
    Fault("truth in some frames", ("truth_sparse",), (2, 5, 10), sparse),
    Fault("region without labels", ("unlabelled",), (30, 60, 90), unlabelled),
    Fault("sensor late", ("sector_late", "late"), (60, 120, 180), late_sensor),
    Fault("sensor off its place", ("sector_offset",), (0.5, 1, 2), moved_sensor),
    Fault(
        "rate too low by 5", ("walking_fast", "driving_fast"), (1, 1, 1), other_rate(5)
    ),
    Fault(
        "rate too low by 2", ("walking_fast", "driving_fast"), (1, 1, 1), other_rate(2)
    ),
    Fault("other clock", ("clock",), (1.1, 1.2, 2), other_clock),
)
