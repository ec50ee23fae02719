"""What the files of a scene say, whatever their form, and the scene that it makes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cards import Card, FilesSource, instead_of_stored
from ...errors import DataError, closest
from ...similar import similar_class
from ...types import ID_LIMIT, Bools, Detections, Floats, ImageField, Ints, Scene, Truth, starts_of_sorted
from ..base import class_ids, no_detections, section_of
from ..motion import backward_velocity
from ..text import LIMIT, RADIANS, TURN, refuse, repeated
from .columns import BOX

LEAST = 1e-6  # m, of the size of a box
FAR = 1e5  # m, of x and y: rollouts keep boxes in single precision, which farther away is too coarse for centimetres
OFF = 0.2  # share by which the frames of a scene may be closer or farther apart than the task says
GAP = 10.5  # periods: more between two frames, and they are of two scenes


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table, in the order of the file."""

    where: Callable[[int, str], str]  # a row and a column of it, for messages
    frame: Ints  # [R]
    box: Floats  # [R, 7]
    velocity: Floats | None  # [R, 2] NaN where unknown; None: in no row
    kind: NDArray[np.str_]  # [R] names of classes
    further: dict[str, NDArray[Any]]  # [R] each: id, eligible, neutral and visible, or score

    def refuse(self, bad: Bools, column: str, what: Callable[[int], str]) -> None:
        """Raise DataError for the first row where ``bad``; ``what`` says what is wrong with it."""
        refuse(bad, lambda at: f"{self.where(at, column)}: {what(at)}")

    def of(self, row: Ints) -> Rows:
        """These rows alone, which no error is about any more."""
        further = {name: column[row] for name, column in self.further.items()}
        velocity = None if self.velocity is None else self.velocity[row]
        return Rows(self.where, self.frame[row], self.box[row], velocity, self.kind[row], further)


@dataclass(frozen=True, eq=False)
class Content:
    """A scene as its files say it, with classes by name."""

    name: str
    where: str  # the file or folder, for messages
    time: Floats  # [F] s
    ego: Floats  # [F, 4]
    truth: Rows
    detections: Rows | None  # None: the files have none
    said: dict[str, Any] = field(default_factory=dict)  # further fields of `Scene`
    image_classes: tuple[str, ...] = ()  # of the box sizes of `Scene.image`


def scene_of(content: Content, card: Card) -> Scene:
    """The scene, with the classes of ``card``; rows of other classes are left out, and counted in ``skipped``.

    Raises DataError for values that no scene can have, and where the frames are not as far apart as the task says.
    """
    _check_time(content, card)
    skipped: dict[str, int] = dict(content.said.get("skipped", {}))
    truth = _usable(content.truth, "truth", content, card.task.classes, skipped)
    rows = content.truth
    rows.refuse(repeated(rows.frame, rows.further["id"]), "id", lambda at: "a second box of this object in this frame")
    _refuse_second_class(content.truth, card.task.classes)
    scene = Scene(
        name=content.name,
        time=content.time,
        ego=content.ego,
        truth=_truth(truth, content.time, card.task.classes),
        detections=no_detections(len(content.time)),
        visible=truth.further.get("visible"),
    )
    scene = replace(scene, **{**content.said, "skipped": skipped})
    if scene.image is not None:
        scene = replace(scene, image=_image(scene.image, content, card))
    if not card.source.traits.truth_complete:
        scene = replace(scene, truth_complete=False)
    return _with_detections(scene, content, card, skipped)


def _image(image: ImageField, content: Content, card: Card) -> ImageField:
    """The image, with the box sizes of the classes of ``card``; those of a similar one where it does not know it."""
    known, rows = content.image_classes, []
    for name in card.task.classes:
        like = similar_class(name, known)
        if like is None:
            raise DataError(
                f"{content.where}: image_classes has no {name!r}, which {card.id} has; found: {', '.join(known)}"
            )
        rows.append(known.index(like))
    return replace(image, box_size=image.box_size[rows])


def _with_detections(scene: Scene, content: Content, card: Card, skipped: dict[str, int]) -> Scene:
    """The scene with the detections of its files, unless those of the card are simulated."""
    if card.detector is not None:
        if not scene.truth_complete:
            raise DataError(
                f"{content.where}: its truth has prediction targets only, so a simulated detector would see nothing "
                "else; take the detections of the files"
            )
        return replace(scene, detector="", simulated=False)
    if content.detections is None:
        raise DataError(f"{content.where}: no detections{instead_of_stored(card)}")
    rows = _usable(content.detections, "detections", content, card.task.classes, skipped)
    unknown = np.full((len(rows.frame), 2), np.nan)
    detections = Detections(
        start=starts_of_sorted(rows.frame, scene.frames),
        box=rows.box,
        velocity=unknown if rows.velocity is None else rows.velocity,
        class_id=class_id_of(rows, card.task.classes),
        score=rows.further["score"],
    )
    label = scene.detector or f"{section_of(card, FilesSource).detector}, stored detections"
    return replace(scene, detections=detections, detector=label)


def _truth(rows: Rows, time: Floats, classes: Sequence[str]) -> Truth:
    """Truth of checked rows, sorted by frame."""
    frame, object_id = rows.frame, rows.further["id"]
    velocity = rows.velocity
    if velocity is None:
        velocity = backward_velocity(frame, object_id, rows.box[:, :2], time)
    return Truth(
        start=starts_of_sorted(frame, len(time)),
        box=rows.box,
        velocity=velocity,
        class_id=class_id_of(rows, classes),
        object_id=object_id,
        eligible=rows.further["eligible"],
        neutral=rows.further["neutral"],
    )


def class_id_of(rows: Rows, classes: Sequence[str]) -> Ints:
    """Place of the class of each row [R] among ``classes``, -1 for one that is not there."""
    known, place = np.unique(rows.kind, return_inverse=True)
    return class_ids(known.tolist(), classes)[place] if len(known) else np.zeros(0, dtype=np.int64)


def _usable(rows: Rows, table: str, content: Content, classes: Sequence[str], skipped: dict[str, int]) -> Rows:
    """The rows of ``classes``, checked and sorted by frame, otherwise in their order."""
    check_rows(rows, len(content.time))
    used = np.isin(rows.kind, classes)
    names, count = (column.tolist() for column in np.unique(rows.kind[~used], return_counts=True))
    if names and not used.any():
        got, known = f"{rows.where(0, 'class')}: {str(rows.kind[0])!r}", ", ".join(classes)
        similar = closest(str(rows.kind[0]), classes)
        advice = f"did you mean {similar!r}?" if similar else "`mtp-bench envs` shows the classes of each environment"
        raise DataError(f"{got}, and no other row of the {table} has a class of the task, one of {known}; {advice}")
    for name, number in zip(names, count, strict=True):
        skipped[f"{table} of class {name!r}, which is none of the task"] = number
    row = np.flatnonzero(used)
    return rows.of(row[np.argsort(rows.frame[row], kind="stable")])


def check_rows(rows: Rows, frames: int) -> None:
    """Raise DataError for the first value that no row can have."""
    outside = (rows.frame < 0) | (rows.frame >= frames)
    rows.refuse(outside, "frame", lambda at: f"frame {rows.frame[at]}, but the scene has the frames 0 to {frames - 1}")
    for place, column in enumerate(BOX):
        _refuse_beyond(rows, column, rows.box[:, place], LEAST if column in ("l", "w", "h") else -LIMIT, LIMIT)
    for place, column in enumerate(("x", "y")):
        _refuse_far(rows, column, rows.box[:, place])
    rows.refuse(np.abs(rows.box[:, 3]) > TURN, "yaw", lambda at: f"{rows.box[at, 3]:g}, {RADIANS}")
    if rows.velocity is not None:
        known = np.where(np.isnan(rows.velocity), 0.0, rows.velocity)
        for place, column in enumerate(("vx", "vy")):
            _refuse_beyond(rows, column, known[:, place], -LIMIT, LIMIT)
    if "id" in rows.further:
        number = rows.further["id"]
        outside = (number < 0) | (number > ID_LIMIT)
        rows.refuse(outside, "id", lambda at: f"{number[at]}, expected a whole number from 0 to {ID_LIMIT}")
    for column, low, high in (("score", -LIMIT, LIMIT), ("visible", 0.0, 1.0)):
        if column in rows.further:
            _refuse_beyond(rows, column, rows.further[column], low, high)


def _refuse_beyond(rows: Rows, column: str, value: Floats, low: float, high: float) -> None:
    rows.refuse(
        ~((value >= low) & (value <= high)),
        column,
        lambda at: f"{value[at]:g}, expected a number from {low:g} to {high:g}",
    )


def _refuse_far(rows: Rows, column: str, value: Floats) -> None:
    rows.refuse(np.abs(value) > FAR, column, lambda at: _too_far(value[at]))


def _too_far(value: float) -> str:
    """What is wrong with a coordinate, and what to do."""
    return (
        f"{value:.10g}, expected -{FAR:g} to {FAR:g} m: boxes are kept in single precision, so subtract a fixed origin "
        "from all coordinates, such as the first place of the ego"
    )


def _refuse_second_class(rows: Rows, classes: Sequence[str]) -> None:
    """An object is of one class; classes that the task does not have say nothing about it."""
    used = np.flatnonzero(np.isin(rows.kind, classes))
    order = used[np.lexsort((rows.frame[used], rows.further["id"][used]))]
    object_id, kind = rows.further["id"][order], rows.kind[order]
    other = np.zeros(len(rows.kind), dtype=bool)
    other[order[1:]] = (np.diff(object_id) == 0) & (kind[1:] != kind[:-1])
    rows.refuse(other, "class", lambda at: f"{str(rows.kind[at])!r}, but this object is of another class before")


def _check_time(content: Content, card: Card) -> None:
    """Frames there are, with rising times, as far apart as the task says."""
    time, where = content.time, content.where
    if not len(time):
        raise DataError(f"{where}: no frames, expected at least one")
    wrong = ~((np.abs(time) < np.inf) & (np.diff(time, prepend=-np.inf) > 0))
    above = "expected a number above that of the frame before"
    refuse(wrong, lambda at: f"{where}: time {time[at]:g} of frame {at}, {above}")
    if not (np.abs(content.ego) <= LIMIT).all():
        raise DataError(f"{where}: the ego has a place that is not finite")
    place, yaw = content.ego[:, :3], content.ego[:, 3]
    moved = np.abs(place - place[0])  # agents see places from the first one on
    expected = f"expected at most {FAR:g} m; make several scenes of it"

    def of_ego(at: int) -> str:
        """A place among all of them."""
        return f"{where}: {'xyz'[at % 3]} of the ego in frame {at // 3} is"

    refuse((np.abs(place) > FAR).ravel(), lambda at: f"{of_ego(at)} {_too_far(float(place.flat[at]))}")
    refuse((moved > FAR).ravel(), lambda at: f"{of_ego(at)} {moved.flat[at]:g} m from that of frame 0, {expected}")
    refuse(np.abs(yaw) > TURN, lambda at: f"{where}: yaw of the ego in frame {at} is {yaw[at]:g}, {RADIANS}")
    require_period(time, card, where)


def require_period(time: Floats, card: Card, where: str) -> None:
    """Raise DataError, which begins with ``where``, unless the frames are as far apart as the task of ``card`` says.

    Some frames may be lacking. Over a longer gap there is no past and no future, and units of uncertainty are blocks
    of frames: two clips are two scenes.
    """
    period = 1.0 / card.task.rate
    found = float(np.median(np.diff(time))) if len(time) > 1 else period
    if abs(found - period) > OFF * period:
        raise DataError(
            f"{where}: frames are {found:g} s apart, but {card.id} has {card.task.rate:g} frames per second: "
            f"{_advice(found, period)}"
        )
    step, most = np.diff(time), GAP * period
    expected = f"expected at most {most:g} s; make a scene of each side"
    refuse(step > most, lambda at: f"{where}: frame {at + 1} is {step[at]:g} s after the one before, {expected}")


def _advice(found: float, period: float) -> str:
    step = round(period / found)
    if step > 1 and abs(step * found - period) <= OFF * period:
        return f"keep every {step}th frame, or take a card with that rate" if step > 3 else f"keep one frame of {step}"
    return "take a card with that rate"
