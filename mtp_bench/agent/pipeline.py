"""The usual agent: a tracker, a predictor and a sampler of pools, which hold all forecasts of an object."""

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import (
    Action,
    Bools,
    Floats,
    Ints,
    Objects,
    Observation,
    ShapeError,
    Task,
    Tracks,
    group,
    select,
)
from .action import FORECAST_LIMIT, FORECAST_REACH
from .building import make_action
from .protocols import Forecasts, Frame, Predictor, Presence, Sampler, Tracker

_POOLED = 2048  # samples in one call of a sampler: its memory must not grow with hypotheses times objects


class Pipeline:
    """Track, predict every distinct track, then reduce the samples to the number allowed.

    The single-hypothesis pipeline (STP) and the multi-hypothesis one (MTP) are this class with trackers of one and of
    H hypotheses. The pool of an object holds the forecasts of all tracks that stand for it in some hypothesis; a pool
    that is larger than the task's K is reduced by the sampler.

    ``weighting``: "posterior" weighs samples by their hypothesis, "uniform" counts hypotheses alike, as in the paper.
    ``min_mass``: an object is reported if hypotheses of at least this total weight hold it; 0.5 is "likelier than not".
    ``presence``: probability that a track's object is there, None: certain. An object's confidence is its mean over
    the hypotheses by their weight, 0 in those that do not hold the object.
    """

    def __init__(
        self,
        tracker: Tracker,
        predictor: Predictor,
        sampler: Sampler,
        weighting: str = "posterior",
        min_mass: float = 0.5,
        presence: Presence | None = None,
    ) -> None:
        if weighting not in ("posterior", "uniform"):
            raise ShapeError(
                f"weighting is {weighting!r}, expected 'posterior' or 'uniform'"
            )
        if not 0 <= min_mass <= 1:
            raise ShapeError(f"min_mass is {min_mass!r}, expected a weight from 0 to 1")
        self._tracker, self._predictor, self._sampler = tracker, predictor, sampler
        self._uniform, self._min_mass, self._presence = (
            weighting == "uniform",
            min_mass,
            presence,
        )

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task, self._number = task, 0
        self._seen: deque[Observation] = deque(maxlen=task.past)
        self._tracker.reset(task)
        self._predictor.reset(task)
        if self._presence is not None:
            self._presence.reset(task)

    def act(self, observation: Observation) -> Action:
        """Answer one frame."""
        if self._task.after_hole(observation):
            self._seen.clear()
        # Copies, since the env may use its arrays again.
        self._seen.append({name: np.copy(value) for name, value in observation.items()})
        action = self._action(self._tracker.step(observation))
        self._number += 1
        return action

    def _action(self, tracks: Tracks) -> Action:
        objects = group(tracks, self._task.objects, self._min_mass)
        used, leaf = _used_tracks(tracks, objects)
        forecasts = self._predictor.predict(
            Frame(self._number, used, tuple(self._seen))
        )
        if not isinstance(forecasts, Forecasts):
            raise ShapeError(
                f"predict returned a {type(forecasts).__name__}, expected mtp_bench.agent.Forecasts"
            )
        row = forecasts.rows_of(used)
        row = np.where(leaf >= 0, row[np.arange(len(row)), leaf], -1)  # [O, H]
        log_weight = (
            np.zeros(len(tracks.log_weight)) if self._uniform else tracks.log_weight
        )
        rng = np.random.default_rng([self._task.seed, self._number + 1, 1])
        samples, weight = reduce_pools(
            make_pools(row, log_weight), forecasts, self._task, self._sampler, rng
        )
        confidence = self._confidence(used, leaf, forecasts.presence, row)
        if forecasts.present is not None:
            heaviest = np.take_along_axis(
                row, (row >= 0).argmax(axis=1)[:, None], axis=1
            )[:, 0]
            box = np.concatenate(
                [forecasts.present[heaviest], objects.box[:, 2:]], axis=1
            )
            objects = replace(objects, box=box)
        known = np.asarray(
            np.isfinite(weight).any(axis=1)
        )  # a predictor may leave tracks without a forecast
        if not known.all():
            objects, samples, weight, confidence = (
                select(objects, known),
                samples[known],
                weight[known],
                confidence[known],
            )
        box, kind = objects.box, objects.class_id
        for axis in range(2):
            samples[..., axis] -= box[:, None, None, axis]
        offset = _within_limit(samples)
        return make_action(
            self._task,
            box,
            kind,
            offset,
            weight,
            confidence=confidence,
            tracks=tracks,
            checked=False,
        )

    def _confidence(
        self, tracks: Tracks, leaf: Ints, presence: Floats | None, row: Ints
    ) -> Floats:
        """Confidence [O]: mean presence over the hypotheses by their weight.

        ``leaf`` [O, H]: the track of each object in each hypothesis; ``presence`` [R]: of rows of forecasts, ``row``
        [O, H] for each object; None: the presence model gives that of tracks.
        """
        if presence is None:
            presence = np.ones(len(tracks.box))
            if self._presence is not None:
                presence = self._presence.probability(tracks, self._seen[-1])
            row = leaf
        held = np.append(presence, 0.0)[
            row
        ]  # a hypothesis that does not hold the object has row -1
        return np.asarray(np.minimum(held @ np.exp(tracks.log_weight), 1.0))


def _used_tracks(tracks: Tracks, objects: Objects) -> tuple[Tracks, Ints]:
    """The tracks that stand for an object, and the one of each object in each hypothesis [O, H], -1: none."""
    place = np.full(len(tracks.box) + 1, -1)  # the last one is of "none"
    place[objects.leaf] = 0
    used = np.flatnonzero(place[:-1] == 0)
    if len(used) == len(tracks.box):
        return tracks, objects.leaf
    place[used], place[-1] = np.arange(len(used)), -1
    return tracks.select(used), place[objects.leaf]


def _within_limit(offset: Floats) -> Floats:
    """Offsets [..., 2], shortened to just below the limit of an action: a wrong track may be that fast."""
    if (np.abs(offset) <= FORECAST_REACH).all():
        return offset
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    shortened = offset * (0.999 * FORECAST_LIMIT / np.maximum(length, 1))
    return np.where(length > FORECAST_LIMIT, shortened, offset)


class Pools(NamedTuple):
    """Rows of `Forecasts` by object: E entries, the entries of one object after another.

    A row has one entry however many hypotheses hold it. Most objects have one entry; the sampler is for the others.
    """

    start: Ints  # [O + 1] first entry of each object
    row: Ints  # [E]
    hypothesis: Ints  # [E] the heaviest hypothesis that holds the row
    log_mass: Floats  # [E] log of the total weight of the hypotheses that hold the row


def make_pools(row: Ints, log_weight: Floats) -> Pools:
    """Pools of O objects: ``row`` [O, H] of each object in each hypothesis, -1: none; ``log_weight`` [H]."""
    owner, hypothesis = np.nonzero(row >= 0)
    rows = row[owner, hypothesis]
    key = owner * (rows.max(initial=0) + 1) + rows
    order = np.argsort(
        key, kind="stable"
    )  # of equal ones the heaviest hypothesis stays first
    key, owner, rows, hypothesis = (
        key[order],
        owner[order],
        rows[order],
        hypothesis[order],
    )
    first = np.flatnonzero(np.append(True, key[1:] != key[:-1])[: len(key)])
    start = np.searchsorted(owner[first], np.arange(len(row) + 1))
    mass = log_weight[
        hypothesis
    ]  # as logarithms: an object of very unlikely hypotheses must not come to a mass of 0
    log_mass = np.logaddexp.reduceat(mass, first) if len(first) else mass
    return Pools(start, rows[first], hypothesis[first], log_mass)


def reduce_pools(
    pools: Pools,
    forecasts: Forecasts,
    task: Task,
    sampler: Sampler,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Samples [O, K, T, 2] and log-weights [O, K] of the objects; -inf for samples that do not exist.

    Only objects with more than K samples go through the sampler.
    """
    each, future = forecasts.samples.shape[1:3]
    weight = normalised(forecasts)
    size = np.diff(pools.start) * each
    samples = np.zeros((len(size), task.samples, future, 2))
    log_weight = np.full(samples.shape[:2], -np.inf)
    small = size <= task.samples
    entry, owner, place = _entries(pools.start, small)
    if np.ndim(forecasts.row) == 2 and len(forecasts.row) * each <= task.samples:  # type: ignore[arg-type]
        place = pools.hypothesis[
            entry
        ]  # where all fit, samples of one hypothesis have the same places in all objects
    slot = place[:, None] * each + np.arange(each)
    samples[owner[:, None], slot] = forecasts.samples[pools.row[entry]]
    log_weight[owner[:, None], slot] = (
        weight[pools.row[entry]] + pools.log_mass[entry][:, None]
    )
    large = np.flatnonzero(~small)
    row, log_mass = entry_table(pools, large)
    at_once = max(1, _POOLED // max(row.shape[1] * each, 1))
    for first in range(0, len(large), at_once):
        part = slice(first, first + at_once)
        pool = padded(forecasts.samples, weight, row[part], log_mass[part])
        samples[large[part]], log_weight[large[part]] = sampler.reduce(
            *pool, task.samples, rng
        )
    return samples, log_weight


def normalised(forecasts: Forecasts) -> Floats:
    """Log-weights [R, S] whose weights have the same sum in each row; -inf throughout where there is no forecast."""
    if forecasts.log_weight is None:
        return np.zeros(forecasts.samples.shape[:2])
    total = np.logaddexp.reduce(forecasts.log_weight, axis=1, keepdims=True)
    known = np.isfinite(total)
    return np.where(known, forecasts.log_weight - np.where(known, total, 0.0), -np.inf)


def _entries(start: Ints, wanted: Bools) -> tuple[Ints, Ints, Ints]:
    """Entries of the ``wanted`` [O] objects, the owner of each, and its place among the owner's entries."""
    count = np.where(wanted, np.diff(start), 0)
    owner = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return start[owner] + place, owner, place


def entry_table(pools: Pools, objects: Ints) -> tuple[Ints, Floats]:
    """Rows [o, E] and log-masses [o, E] of the entries of some objects; row 0 of mass -inf for missing entries."""
    wanted = np.zeros(len(pools.start) - 1, dtype=bool)
    wanted[objects] = True
    entry, owner, place = _entries(pools.start, wanted)
    line = np.searchsorted(objects, owner)
    row = np.zeros((len(objects), place.max(initial=-1) + 1), dtype=np.int64)
    log_mass = np.full(row.shape, -np.inf)
    row[line, place], log_mass[line, place] = pools.row[entry], pools.log_mass[entry]
    return row, log_mass


def padded(
    samples: Floats, weight: Floats, row: Ints, log_mass: Floats
) -> tuple[Floats, Floats]:
    """Samples [o, S, T, 2] and log-weights [o, S] of pools whose entries have the rows and log-masses [o, E]."""
    log_weight = weight[row] + log_mass[:, :, None]
    return samples.take(row, axis=0).reshape(
        len(row), -1, *samples.shape[2:]
    ), log_weight.reshape(len(row), -1)
