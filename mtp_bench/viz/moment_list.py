"""Moments of a run: frames in which a forecast went wrong, and names that find them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core import Bools, Floats, Ints, MtpBenchError, UnknownNameError
from ..scoring import (
    BELOW_THRESHOLD,
    PARTS,
    blame,
    history,
    named_parts,
    separated_truth,
)
from .evidence import borrowed
from .incident import INCIDENT_KINDS, Incident
from .part_ranking import ranked_parts
from .run_replay import Replay

AT = (
    "an event, OBJECT@FRAME, an object, a frame (20) or a time (12.5s); "
    "`events` and `worst` list them"
)
GAP_SECONDS = 0.5  # between two bad frames of one moment, at most
_WHOLE_NUMBER = r"\d{1,9}"


@dataclass(frozen=True)
class Moment:
    """A run of bad frames of one object."""

    at: Incident  # its worst frame among those of its cause, with the span
    frames: int  # targets in it
    cost: float  # m, summed over them, that it is sorted by
    parts: dict[str, float]  # m, by name, means over them
    distance: float | None  # m from the ego to the object, in that frame; None: no ego
    borrowed: bool  # in most frames of its cause the detections are of other objects

    @property
    def cause(self) -> str:
        """Name of the largest part."""
        return next(iter(self.parts))

    @property
    def fault(self) -> str:
        """The stage at fault, empty without an error."""
        ranking = ranked_parts(self.parts, self.borrowed)
        return ranking[0][0] if ranking else ""


def costs(part: Floats, below: bool = False) -> Floats:
    """Return costs [...] of the ``part`` [..., len(PARTS)] of errors, m.

    They are the blame, or with ``below`` the part below threshold.
    """
    if below:
        return part[..., PARTS.index(BELOW_THRESHOLD)]
    return blame(part)


def moments(replay: Replay, below: bool = False) -> list[Moment]:
    """List the moments of a run by falling cost.

    A frame is bad if its cost is at least the mean of the run. ``below``: the cost is
    the part below threshold, instead of the blame, which has all others.
    """
    cost = costs(replay.part, below)
    threshold_m = replay.mean_blame_m
    if below and np.isfinite(cost).any():
        threshold_m = float(np.nanmean(cost))
    # a margin for rounding: frames that all cost the same are all bad
    is_bad = (cost > 0) & (cost >= threshold_m * (1 - 1e-9))
    found_moments = [_moment(replay, rows, cost) for rows in _spans(replay, is_bad)]
    return sorted(found_moments, key=lambda moment: -moment.cost)


def _spans(replay: Replay, is_bad: Bools) -> Iterator[Ints]:
    """Yield rows of targets of each run of bad frames."""
    truth = replay.scene.truth
    identity = separated_truth(replay.scene, replay.card).object_id
    objects = history(truth.frame_of_rows, identity)
    positions = np.flatnonzero(is_bad[objects.order])  # by object, then by frame
    if not len(positions):
        return
    max_step = 1 + round(GAP_SECONDS * replay.card.task.rate)
    other_object = np.diff(objects.identity[positions]) != 0
    is_gap = np.diff(objects.frame[positions]) > max_step
    for span in np.split(positions, np.flatnonzero(other_object | is_gap) + 1):
        rows = objects.order[span[0] : span[-1] + 1]  # with short gaps inside
        yield rows[np.isfinite(replay.part[rows, 0])]


def _moment(replay: Replay, rows: Ints, cost: Floats) -> Moment:
    """Return the moment of the targets ``rows`` [n], with ``cost`` [R], m."""
    frame = replay.scene.truth.frame_of_rows
    part = replay.part[rows]
    parts = named_parts(part.mean(axis=0))
    cause_name = next(iter(parts))
    names = np.array(PARTS)
    # largest part of each frame, with below threshold last
    frame_cause = names[
        np.where(names == BELOW_THRESHOLD, -np.inf, part).argmax(axis=1)
    ]
    # the frames of the moment's cause first, each by falling cost
    order = np.lexsort((-cost[rows].round(3), frame_cause != cause_name))
    worst_row = int(rows[order[0]])
    cause_part = part[:, names == cause_name].ravel()
    borrowed_part = cause_part[borrowed(replay)[rows]]
    place = replay.scene.truth.box[worst_row, :2]
    first = int(frame[rows[0]])
    until = int(frame[rows[-1]])
    return Moment(
        at=replace(replay.moment(worst_row), first=first, until=until),
        frames=len(rows),
        cost=float(cost[rows].sum()),
        parts=parts,
        distance=replay.ego_distance(frame[worst_row], place),
        borrowed=bool(2 * borrowed_part.sum() > cause_part.sum()),
    )


def find_incident(replay: Replay, text: str) -> Incident:
    """Find the incident that ``text`` names, see `AT`.

    An object stands for its worst moment, a frame for its worst target. An object is
    named by its id in the source, or the beginning of it, with its class before it or
    not. Raises UnknownNameError, and MtpBenchError for a frame without a target.
    """
    object_ids = np.unique(replay.scene.truth.object_id).tolist()
    is_object = text in map(replay.scene.name_of, object_ids)
    kinds = "|".join(INCIDENT_KINDS)
    if re.fullmatch(rf"({kinds})-\d+", text) and not is_object:
        return replay.incident(text)
    if re.fullmatch(_WHOLE_NUMBER, text):
        return _worst_of(replay, _require_frame(replay, int(text), text))
    if time_s := re.fullmatch(rf"({_WHOLE_NUMBER}(?:\.\d{{1,9}})?) ?s", text):
        return _worst_of(replay, _frame_at(replay, float(time_s[1]), text))
    name, _, frame = text.rpartition("@")
    if name and re.fullmatch(_WHOLE_NUMBER, frame) and not is_object:
        return _in_frame(replay, _rows_of(replay, name), int(frame), text)
    rows = _rows_of(replay, text)
    for moment in moments(replay):
        if moment.at.row in rows:
            return moment.at
    # an object without a moment: its costliest frame, targets before others
    cost = np.nan_to_num(costs(replay.part)[rows], nan=-1.0)
    return replay.moment(int(rows[np.argmax(cost)]))


def _frame_at(replay: Replay, time_s: float, text: str) -> int:
    """Return the frame nearest to a time, at most a second after the last."""
    time = replay.scene.time - replay.scene.time[0]
    if time_s > time[-1] + 1.0:
        _require_frame(replay, replay.frames, text)  # raises the error
    return int(np.argmin(np.abs(time - time_s)))


def _require_frame(replay: Replay, t: int, text: str) -> int:
    """Return frame ``t``, which a user named ``text``.

    Raises MtpBenchError if the scene ends before.
    """
    if t >= replay.frames:
        raise MtpBenchError(
            f"{text}: scene {replay.scene.name} ends at frame {replay.frames - 1}, "
            f"{replay.scene.seconds(-1):.1f} s"
        )
    return t


def _in_frame(replay: Replay, rows: Ints, t: int, text: str) -> Incident:
    """Return an object in frame ``t`` with its moment's span.

    Raises MtpBenchError if the object is not there.
    """
    frames = replay.scene.truth.frame_of_rows[rows]
    if t not in frames:
        raise MtpBenchError(
            f"{text}: the object is not in frame {t}, but in frames {frames[0]} to "
            f"{frames[-1]}"
        )
    at = replay.moment(int(rows[np.searchsorted(frames, t)]))
    for moment in moments(replay):
        span = moment.at
        if span.object_id == at.object_id and span.first <= t <= span.until:
            return replace(at, first=span.first, until=span.until)
    return at


def _rows_of(replay: Replay, name: str) -> Ints:
    """Return rows of the object of this name.

    Raises UnknownNameError without one. The name may have the class before it.
    """
    scene = replay.scene
    object_ids, first_rows = np.unique(scene.truth.object_id, return_index=True)
    names = {number: scene.name_of(number) for number in object_ids.tolist()}
    numbers = _named_objects(names, name)
    if len(numbers) != 1:  # the class may come before
        noun, _, object_word = name.rpartition(" ")
        class_ids = scene.truth.class_id[first_rows].tolist()
        classes = [replay.card.task.classes[class_id] for class_id in class_ids]
        of_class = {
            number
            for number, class_name in zip(names, classes, strict=True)
            if class_name.replace("_", " ") == noun.replace("_", " ")
        }
        numbers = [n for n in _named_objects(names, object_word) if n in of_class]
    if len(numbers) != 1:
        raise UnknownNameError(
            f"object of scene {scene.name}",
            name,
            list(names.values()),
            "`mtp-bench worst` lists the worst of them, `events` events",
        )
    return np.flatnonzero(scene.truth.object_id == numbers[0])


def _named_objects(names: Mapping[int, str], object_word: str) -> list[int]:
    """Return the numbers of objects that a word names.

    It is the whole id, else the number, else the beginning of ids.
    """
    exact = [number for number, name in names.items() if name == object_word]
    by_number = [
        number for number in names if object_word.removeprefix("#") == str(number)
    ]
    begins = [
        number
        for number, name in names.items()
        if object_word and name.startswith(object_word)
    ]
    return exact or by_number or begins


def _worst_of(replay: Replay, t: int) -> Incident:
    """Return the worst target of frame ``t``.

    Raises MtpBenchError without one.
    """
    frame = replay.scene.truth.frame_of_rows
    is_target = np.isfinite(replay.part[:, 0])
    rows = np.flatnonzero((frame == t) & is_target)
    if len(rows):
        return replay.moment(int(rows[np.argmax(costs(replay.part)[rows])]))
    targets = frame[is_target]
    frames_text = "no frame has one"
    if len(targets):
        frames_text = f"frames {targets[0]} to {targets[-1]} have some"
    raise MtpBenchError(
        f"frame {t} of scene {replay.scene.name} has no target: {frames_text}; name an "
        f"object, OBJECT@{t}"
    )
