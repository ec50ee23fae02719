"""Moments of a run: frames in which a forecast went wrong, with or without an event, and names that lead to them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..core import Bools, Floats, Ints, MtpBenchError, UnknownNameError
from ..scoring import (
    BELOW,
    PARTS,
    blame,
    history,
    named_parts,
    near_pairs,
    separated_truth,
)
from .incident import INCIDENT_KINDS, Incident
from .run_replay import Replay

AT = "an event, OBJECT@FRAME, an object, a frame (20) or a time (12.5s); `events` and `worst` list them"
GAP_SECONDS = 0.5  # between two bad frames of one moment, at most


@dataclass(frozen=True)
class Moment:
    """A run of bad frames of one object."""

    at: Incident  # its worst frame among those of its cause, with the span
    frames: int  # targets in it
    cost: float  # m, summed over them, that it is sorted by
    parts: dict[str, float]  # m, by name, means over them
    distance: float | None  # m from the ego to the object, in that frame; None: no ego
    borrowed: bool  # in most frames of its cause, the detections behind it are matched to other objects

    @property
    def cause(self) -> str:
        """Name of the largest part."""
        return next(iter(self.parts))


def costs(part: Floats, below: bool = False) -> Floats:
    """Cost [...] of the ``part`` [..., len(PARTS)] of errors, m: their blame, or the part ``below`` threshold."""
    return part[..., list(PARTS.values()).index(BELOW)] if below else blame(part)


def moments(run: Replay, below: bool = False) -> list[Moment]:
    """Moments of a run by falling cost; a frame is bad whose cost is above what is usual in the run.

    ``below``: the cost is the part below threshold, instead of all others.
    """
    cost = costs(run.part, below)
    usual = float(np.nanmean(cost)) if below and np.isfinite(cost).any() else run.usual
    bad = (cost > 0) & (
        cost >= usual * (1 - 1e-9)
    )  # all of them where they cost the same
    return sorted(
        (_moment(run, rows, cost) for rows in _spans(run, bad)), key=lambda m: -m.cost
    )


def _spans(run: Replay, bad: np.ndarray) -> Iterator[Ints]:
    """Rows of the targets from the first to the last bad frame of each run of bad frames."""
    objects = history(
        run.scene.truth.frame_of_rows, separated_truth(run.scene, run.card).object_id
    )
    place = np.flatnonzero(bad[objects.order])
    most = 1 + round(GAP_SECONDS * run.card.task.rate)
    step, other = np.diff(objects.frame[place]), np.diff(objects.identity[place]) != 0
    for span in (
        np.split(place, np.flatnonzero(other | (step > most)) + 1) if len(place) else ()
    ):
        rows = objects.order[span[0] : span[-1] + 1]
        yield rows[np.isfinite(run.part[rows, 0])]


def _moment(run: Replay, rows: Ints, cost: Floats) -> Moment:
    frame, part = run.scene.truth.frame_of_rows, run.part[rows]
    parts = named_parts(part.mean(axis=0))
    names = np.array(list(PARTS.values()))
    first = names[
        np.where(names == BELOW, -np.inf, part).argmax(axis=1)
    ]  # cause of each frame
    cause = next(iter(parts))
    of_cause = part[:, names == cause].ravel()
    worst = int(rows[np.lexsort((-cost[rows].round(3), first != cause))[0]])
    gap = run.scene.truth.box[worst, :2] - run.scene.ego[frame[worst], :2]
    return Moment(
        at=replace(
            run.moment(worst), first=int(frame[rows[0]]), until=int(frame[rows[-1]])
        ),
        frames=len(rows),
        cost=float(cost[rows].sum()),
        parts=parts,
        distance=float(np.hypot(*gap)) if run.card.has_ego else None,
        borrowed=bool(2 * of_cause[borrowed(run)[rows]].sum() > of_cause.sum()),
    )


_SEEN = [
    list(PARTS).index(name) for name in ("no_forecast", "other_class", "off_place")
]  # causes with a detection


@lru_cache(maxsize=4)  # asked for every moment of a run
def borrowed(run: Replay) -> Bools:
    """Mask [R] of the true boxes whose detections within two gates are all matched to other objects."""
    truth, seen = run.scene.truth, run.scene.detections
    gate = 2 * np.asarray(
        run.card.per_class(run.card.task.forecast_gate), dtype=np.float64
    )
    at = truth.frame_of_rows, truth.box[:, :2]
    row, column, distance = near_pairs(
        *at, seen.frame_of_rows, seen.box[:, :2], float(gate.max())
    )
    inside = distance <= gate[truth.class_id[row]]
    others = (run.detected[column] >= 0) & (
        run.detected[column] != truth.object_id[row]
    )
    count, of_others = (
        np.bincount(row[mask], minlength=len(truth.box))
        for mask in (inside, inside & others)
    )
    return np.asarray(
        (count > 0) & (count == of_others) & (run.part[:, _SEEN].sum(axis=1) > 0)
    )


def found(run: Replay, text: str) -> Incident:
    """The incident that ``text`` names: an event, ``OBJECT@FRAME``, an object, a frame (20) or a time (12.5s).

    An object stands for its worst moment, a frame for its worst target. An object is named by its id in the source, or
    the beginning of it, with its class before it or not. Raises UnknownNameError, and MtpBenchError for a frame without
    a target.
    """
    ids = set(map(run.scene.name_of, np.unique(run.scene.truth.object_id).tolist()))
    seconds = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?) ?s", text)
    name, _, frame = text.rpartition("@")
    if re.fullmatch(rf"({'|'.join(INCIDENT_KINDS)})-\d+", text) and text not in ids:
        return run.incident(text)
    if seconds or re.fullmatch(r"\d{1,9}", text):
        time = run.scene.time - run.scene.time[0]
        t = int(np.argmin(np.abs(time - float(seconds[1])))) if seconds else int(text)
        if t >= run.frames or (seconds and float(seconds[1]) > time[-1] + 1.0):
            raise MtpBenchError(
                f"{text}: scene {run.scene.name} ends at frame {run.frames - 1}, {time[-1]:.1f} s"
            )
        return _worst_of(run, t)
    if name and re.fullmatch(r"\d{1,9}", frame) and text not in ids:
        return _in_frame(run, _rows_of(run, name), int(frame), text)
    rows = _rows_of(run, text)
    own = (each.at for each in moments(run) if each.at.row in rows)
    return next(own, None) or run.moment(
        int(rows[np.argmax(np.nan_to_num(costs(run.part)[rows], nan=-1.0))])
    )


def _in_frame(run: Replay, rows: Ints, t: int, text: str) -> Incident:
    """An object in frame ``t``, with the span of the moment that this is part of; MtpBenchError if it is not there."""
    frames = run.scene.truth.frame_of_rows[rows]
    if t not in frames:
        raise MtpBenchError(
            f"{text}: the object is not in frame {t}, but in frames {frames[0]} to {frames[-1]}"
        )
    at = run.moment(int(rows[np.searchsorted(frames, t)]))
    spans = (each.at for each in moments(run) if each.at.object_id == at.object_id)
    span = next((each for each in spans if each.first <= at.frame <= each.until), at)
    return replace(at, first=span.first, until=span.until)


def _rows_of(run: Replay, name: str) -> Ints:
    """Rows of the object of this name; raises UnknownNameError."""
    scene, classes = run.scene, run.card.task.classes
    numbers, first = np.unique(scene.truth.object_id, return_index=True)
    ids = {scene.name_of(int(number)): int(number) for number in numbers}
    nouns = {
        int(scene.truth.object_id[row]): classes[scene.truth.class_id[row]].replace(
            "_", " "
        )
        for row in first
    }
    word = name.rpartition(" ")[2]
    for own in (name, word):
        # the id itself, else its number, else the only one that begins so
        exact = [number for each, number in ids.items() if own == each]
        known = exact or [
            number for number in nouns if own.removeprefix("#") == str(number)
        ]
        known = known or [
            number for each, number in ids.items() if own and each.startswith(own)
        ]
        known = [
            number
            for number in known
            if own == name or name.replace("_", " ") == f"{nouns[number]} {own}"
        ]
        if len(known) == 1:
            return np.flatnonzero(scene.truth.object_id == known[0])
    raise UnknownNameError(
        f"object of scene {scene.name}",
        name,
        list(ids),
        "`mtp-bench worst` lists the worst of them, `events` events",
    )


def _worst_of(run: Replay, t: int) -> Incident:
    """The worst target of frame ``t``; raises MtpBenchError without one."""
    rows = np.flatnonzero(
        (run.scene.truth.frame_of_rows == t) & np.isfinite(run.part[:, 0])
    )
    if len(rows):
        return run.moment(int(rows[np.argmax(costs(run.part)[rows])]))
    targets = run.scene.truth.frame_of_rows[np.isfinite(run.part[:, 0])]
    has = (
        f"frames {targets[0]} to {targets[-1]} have some"
        if len(targets)
        else "no frame has one"
    )
    raise MtpBenchError(
        f"frame {t} of scene {run.scene.name} has no target: {has}; name an object, OBJECT@{t}"
    )
