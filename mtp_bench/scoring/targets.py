"""Targets, why one may lack a forecast, live frames and units of uncertainty.

Definitions: docs/definitions, "Targets" and "Ranks". Neutral objects, which no label
could confirm or refute, are left out. KITTI is labelled in images: an object is
placed into the image from its x and y alone, since an agent could choose the other
numbers of a forecast freely.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import (
    Bools,
    DataError,
    Floats,
    ImageField,
    Ints,
    Ragged,
    Scene,
    ShapeError,
    in_groups,
    rotate,
    wrap_angle,
)
from .definitions import (
    BLOCK_SECONDS,
    CAMERA_HEIGHT,
    LEAST_IMAGE_HEIGHT,
    MOST_IN_REGION,
    MOVING_SPEED,
    TURNING,
)
from .events import (
    HOLES,
    LOST_TARGETS,
    counted_in_run,
    history,
    pieces,
    separated,
    separated_truth,
)
from .pairs import near_pairs

_MIN_DEPTH_M = 0.1  # before the camera: what is nearer or behind is cut off
# [8, 3] along, across, up, of a box of size 1
_CORNER = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
_CORNER = _CORNER - [0.5, 0.5, 0.0]
# [2, 24] corners: every edge from both ends
_ENDS = np.array(
    [(i, j) for i in range(8) for j in range(8) if (i ^ j).bit_count() == 1]
).T


def evaluated(scene: Scene) -> Scene:
    """Return a scene as it is evaluated.

    True boxes that no label could confirm are neutral, never targets.
    """
    if scene.image is None and scene.neutral_areas is None:
        return scene
    truth = scene.truth
    hidden = neutral_places(
        scene, truth.frame_of_rows, truth.box[:, :2], truth.class_id
    )
    truth = replace(
        truth, eligible=truth.eligible & ~hidden, neutral=truth.neutral | hidden
    )
    return replace(scene, truth=truth)


def neutral_places(scene: Scene, frame: Ints, xy: Floats, class_id: Ints) -> Bools:
    """Return True [n] for objects that no label of the scene could confirm.

    At ``xy`` [n, 2] m, scene's frame of reference: those that are `unlabelled`, and
    those that its image does not confirm. An object of ``class_id`` [n] in ``frame``
    [n] is seen as an upright box of the size that stands for its class, with the
    heading of the platform and its bottom 1.65 m below the camera. In the image it is the least rectangle around that box as far as it lies
    before the camera, cut to the image. No label confirms it if nothing of it is left,
    if it is at most 25 pixels high, or if more than half of it lies in one region where
    labels do not care.
    """
    without_label = unlabelled(scene, frame, xy)
    image = scene.image
    if image is None:
        return without_label
    box = _image_boxes(image, frame, np.asarray(xy, dtype=np.float64), class_id)
    is_wide = box[:, 2] > box[:, 0]
    is_high = box[:, 3] - box[:, 1] > LEAST_IMAGE_HEIGHT
    in_region = _share_in_region(image, frame, box) > MOST_IN_REGION
    return np.asarray(without_label | ~(is_high & is_wide) | in_region)


def unlabelled(scene: Scene, frame: Ints, xy: Floats) -> Bools:
    """Return True [n] in frames that are not annotated, and in neutral areas.

    ``xy`` [n, 2] m, scene's frame of reference, in ``frame`` [n].
    """
    without_label = np.zeros(len(frame), dtype=bool)
    if scene.annotated is not None:
        without_label = ~scene.annotated[frame]
    if scene.neutral_areas is not None:
        place = _in_world(scene, xy, frame)[:, None]
        low = scene.neutral_areas[:, :2]
        high = scene.neutral_areas[:, 2:]
        inside = np.all((place >= low) & (place <= high), axis=2)
        without_label |= inside.any(axis=1)
    return without_label


def _image_boxes(image: ImageField, frame: Ints, xy: Floats, class_id: Ints) -> Floats:
    """Return left, top, right, bottom [n, 4] of objects in the image, pixels.

    Right is left of left where nothing is seen.
    """
    offset = _CORNER * image.box_size[class_id][:, None]  # [n, 8, 3]
    cos = np.cos(image.heading[frame])[:, None]
    sin = np.sin(image.heading[frame])[:, None]
    corner = np.ones((len(xy), 8, 4))  # homogeneous: the last one stays 1
    corner[..., 0] = xy[:, :1] + cos * offset[..., 0] - sin * offset[..., 1]
    corner[..., 1] = xy[:, 1:] + sin * offset[..., 0] + cos * offset[..., 1]
    corner[..., 2] = (image.height[frame] - CAMERA_HEIGHT)[:, None] + offset[..., 2]
    point = corner @ image.projection[frame].swapaxes(1, 2)  # u w, v w, w
    start = point[:, _ENDS[0]]  # [n, 24, 3]
    end = point[:, _ENDS[1]]
    start_depth = start[..., 2]
    end_depth = end[..., 2]
    visible = np.maximum(start_depth, end_depth) >= _MIN_DEPTH_M
    # the edge comes out in front of the camera: it starts there
    cut = visible & (start_depth < _MIN_DEPTH_M)
    depth_change = np.where(cut, end_depth - start_depth, 1.0)
    share = np.where(cut, (_MIN_DEPTH_M - start_depth) / depth_change, 0.0)
    start = start + share[..., None] * (end - start)
    pixel = start[..., :2] / np.where(visible, start[..., 2], 1.0)[..., None]
    top_left = np.where(visible[..., None], pixel, np.inf).min(axis=1)
    bottom_right = np.where(visible[..., None], pixel, -np.inf).max(axis=1)
    return np.concatenate(
        [np.maximum(top_left, 0.0), np.minimum(bottom_right, image.size)], axis=1
    )


def _share_in_region(image: ImageField, frame: Ints, box: Floats) -> Floats:
    """Return the largest share [n] of image boxes [n, 4] in one region of a frame."""
    first = image.region_start[frame]
    count = image.region_start[frame + 1] - first
    # each box beside each region of its frame
    row, place = in_groups(count)
    region = image.region[first[row] + place]
    row_box = box[row]
    top_left = np.maximum(row_box[:, :2], region[:, :2])
    bottom_right = np.minimum(row_box[:, 2:], region[:, 2:])
    common_area = np.maximum(bottom_right - top_left, 0.0).prod(axis=1)
    box_area = np.maximum(row_box[:, 2:] - row_box[:, :2], 0.0).prod(axis=1)
    row_share = np.zeros(len(row))
    np.divide(common_area, box_area, out=row_share, where=box_area > 0)
    share = np.zeros(len(box))
    np.maximum.at(share, row, row_share)
    return share


# of BLOCK_SECONDS, by which the blocks of a scene may exceed it together, for 41 frames
# at 2 Hz
_EXCESS = 0.05


@dataclass(frozen=True, eq=False)
class Targets(Ragged):
    """Targets of a scene, ``n`` of them, sorted by their row in the truth.

    T here counts the annotated frames of the forecast horizon.
    """

    row: Ints  # [n] row of the truth
    frame: Ints  # [n]
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    # [n, T] step of a forecast, from 0, that is compared with each future frame
    step: Ints
    future: Floats  # [n, T, 2] true x y of the next T frames, m, frame of the scene
    distance: Floats  # [n] m to the ego now (BEV)
    approach: Floats  # [n] m, nearest BEV distance to the ego over the future
    # [n] straight displacement over the future, by its time, above MOVING_SPEED
    moving: Bools
    # [n] heading changes by more than TURNING from now to the last future frame
    turning: Bools

    def __len__(self) -> int:
        return len(self.row)


def find_targets(scene: Scene, card: Card) -> Targets:
    """Return the targets of ``scene``.

    A target is eligible, not neutral, and has P past frames (the current one included)
    and T future ones. Objects that no label of an image could confirm are neutral. The
    P + T frames are consecutive, without a hole in time, and the object may be neutral
    in all but the current one. Targets of an official list need the T future frames
    only. Of a partly annotated scene the annotated frames alone count, see `_windows`.
    ``moving`` and ``turning`` are measured in the world also where every frame
    has its own frame of reference; where headings are nominal, no target turns. Raises
    DataError where an object occurs twice in a frame.
    """
    truth = evaluated(scene).truth
    past, future = _windows(scene, card)
    frame = truth.frame_of_rows
    place = scene.annotated_place[frame]
    piece = pieces(scene, card)[frame]
    try:
        objects = history(place, separated(truth.object_id, piece))
    except ShapeError as error:
        raise DataError(f"scene {scene.name!r}: {error}") from None
    length = past + future
    first = _window_starts(objects.identity, objects.frame, length)
    rows = objects.order[first[:, None] + np.arange(length)]
    present = rows[:, past - 1]
    is_target = truth.eligible[present] & ~truth.neutral[present]
    is_target &= live_frames(scene, card)[frame[present]]
    rows = rows[is_target][np.argsort(present[is_target])]
    present = rows[:, past - 1]
    end = rows[:, -1]
    xy = np.asarray(truth.box[:, :2], dtype=np.float64)
    future_xy = xy[rows[:, past:]]
    future_frame = frame[rows[:, past:]]
    step = np.minimum(future_frame - frame[present][:, None], card.task.future) - 1
    ego_xy = np.asarray(scene.ego[:, :2], dtype=np.float64)
    future_distance = np.linalg.norm(future_xy - ego_xy[future_frame], axis=-1)
    world_start = _in_world(scene, xy[present], frame[present])
    world_end = _in_world(scene, xy[end], frame[end])
    displacement = np.linalg.norm(world_end - world_start, axis=-1)
    seconds = scene.time[frame[end]] - scene.time[frame[present]]
    turning = np.zeros(len(present), dtype=bool)
    if not card.source.traits.places_only:
        turning = _heading_change(scene, end, present) > TURNING
    return Targets(
        start=np.searchsorted(frame[present], np.arange(scene.frames + 1)),
        row=present,
        frame=frame[present],
        object_id=np.asarray(truth.object_id)[present],
        class_id=np.asarray(truth.class_id)[present],
        step=step,
        future=future_xy,
        distance=np.linalg.norm(xy[present] - ego_xy[frame[present]], axis=-1),
        approach=future_distance.min(axis=1, initial=np.inf),
        moving=displacement > MOVING_SPEED * seconds,
        turning=turning,
    )


def _windows(scene: Scene, card: Card) -> tuple[int, int]:
    """Return the annotated frames of past, the current one included, and future.

    They are those of the card's windows if every frame that is annotated follows the
    one before at the usual step of the scene.
    """
    step = scene.annotated_step
    past = 1 if scene.listed_targets else -(-card.task.past // step)
    return past, card.task.future // step


class AbsentCause(IntEnum):
    """Why a target may have no forecast: the first cause that holds.

    The detections decide on it; what the agent did with them does not count.
    """

    NO_FORECAST = 0  # a detection of its class lies inside the forecast gate
    OTHER_CLASS = 1  # one of another class does
    OFF_PLACE = 2  # one of its class lies within two gates
    # none of its class lay inside the gate in any earlier frame of the object
    UNDETECTED_NEW = 3
    UNDETECTED_SEEN = 4


def absent_causes(scene: Scene, targets: Targets, card: Card) -> Ints:
    """Return values of `AbsentCause` [n] of the ``targets``.

    Frames in which an object is neutral are frames of it too. After a hole in time an
    object is another one.
    """
    truth = separated_truth(scene, card)
    detections = scene.detections
    gate = np.asarray(card.per_class(card.task.forecast_gate), dtype=np.float64)
    frame = truth.frame_of_rows
    row, column, distance = near_pairs(
        frame,
        truth.box[:, :2],
        detections.frame_of_rows,
        detections.box[:, :2],
        2 * float(gate.max()),
    )
    pair_gate = gate[truth.class_id[row]]
    same_class = truth.class_id[row] == detections.class_id[column]
    inside = distance <= pair_gate

    def has_pair(mask: Bools) -> Bools:
        """Return True [R] for true boxes with such a pair."""
        return np.bincount(row[mask], minlength=len(frame)) > 0

    detected = has_pair(same_class & inside)
    other_class = has_pair(~same_class & inside)
    off_place = has_pair(same_class & (distance <= 2 * pair_gate))
    objects = history(frame, truth.object_id)
    detections_so_far = counted_in_run(objects.follows, detected[objects.order])
    ever_detected = np.zeros(len(frame), dtype=bool)
    ever_detected[objects.order] = detections_so_far > 0
    conditions = [detected, other_class, off_place, ~ever_detected]
    return np.select(
        [condition[targets.row] for condition in conditions],
        list(AbsentCause)[: len(conditions)],
        AbsentCause.UNDETECTED_SEEN,
    )


def live_frames(scene: Scene, card: Card) -> Bools:
    """Return the frames [F] in which a target can exist.

    Only there false forecasts count (docs/definitions, "Targets"). The last annotated
    frame of the future may lie half a step beyond the forecast.
    """
    past, future = _windows(scene, card)
    frames = scene.annotated_frames
    place = np.arange(len(frames))
    first = frames[np.maximum(place - past + 1, 0)]
    last = frames[np.minimum(place + future, len(frames) - 1)]
    piece = pieces(scene, card)
    inside = (place >= past - 1) & (place < len(frames) - future)
    inside &= last - frames <= card.task.future + scene.annotated_step / 2
    live = np.zeros(scene.frames, dtype=bool)
    live[frames] = inside & (piece[first] == piece[last])
    return live


def count_holes(scene: Scene, card: Card) -> dict[str, int]:
    """Count the holes in time of a scene, and the targets they cost.

    Empty without holes. The counts stand beside `Scene.skipped`.
    """
    even_scene = replace(scene, time=np.arange(scene.frames) / card.task.rate)
    gaps = pieces(even_scene, card).max(initial=0)
    holes = int(pieces(scene, card).max(initial=0) - gaps)
    if not holes:
        return {}
    targets = len(find_targets(even_scene, card)) - len(find_targets(scene, card))
    return {HOLES: holes, LOST_TARGETS: targets}


def _in_world(scene: Scene, xy: Floats, frame: Ints) -> Floats:
    """Return places [n, 2] m of ``frame`` [n] in the scene's frame of reference.

    All frames of the scene share it.
    """
    if scene.world is None:
        return xy
    return rotate(xy, scene.world[frame, 3]) + scene.world[frame, :2]


def _heading_change(scene: Scene, end: Ints, present: Ints) -> Floats:
    """Return the change of heading [n] in the world between two rows of the truth."""
    heading = np.asarray(scene.truth.box[:, 3], dtype=np.float64)
    if scene.world is not None:
        heading = heading + scene.world[scene.truth.frame_of_rows, 3]
    return np.abs(wrap_angle(heading[end] - heading[present]))


def _window_starts(ids: Ints, frames: Ints, length: int) -> NDArray[np.intp]:
    """Return the first rows [n] of ``length`` consecutive frames of one object."""
    if len(ids) < length:
        return np.zeros(0, dtype=np.intp)
    start = slice(0, len(ids) - length + 1)
    end = slice(length - 1, len(ids))
    consecutive = frames[end] - frames[start] == length - 1
    return np.flatnonzero((ids[start] == ids[end]) & consecutive)


def units(scene: Scene, card: Card) -> Ints:
    """Return the index of the block [F] of each frame.

    Blocks of at most 20 s are the units of uncertainty. They have equal numbers of
    frames, up to one, and are as few as possible. The frames must be about equally
    spaced in time; a hole counts as one period. Annotated frames alone count; another
    is in the block of the one before.
    """
    frames = scene.annotated_frames
    count = len(frames)
    if count < 2:
        return np.zeros(scene.frames, dtype=np.int64)
    time = scene.time[frames]
    excess = np.diff(time) - scene.annotated_step / card.task.rate
    hole_seconds = excess[np.diff(pieces(scene, card)[frames]) > 0].sum()
    span = float(time[-1] - time[0] - hole_seconds)
    seconds = span * count / (count - 1)
    # times are sums of rounded periods
    blocks = max(1, int(np.ceil(round(seconds / BLOCK_SECONDS - _EXCESS, 9))))
    return np.maximum(scene.annotated_place, 0) * blocks // count
