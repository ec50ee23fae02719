"""Usual agent: a tracker, a predictor, and a sampler of the forecasts of each object."""

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
    in_groups,
    select,
)
from .action import FORECAST_LIMIT, FORECAST_REACH
from .building import make_action
from .protocols import Forecasts, Frame, Predictor, Presence, Sampler, Tracker

# samples in one call of a sampler: its memory must not grow with hypotheses times
# objects
_SAMPLES_PER_CALL = 16384
_BELOW_LIMIT = 0.999  # share of the limit that a shortened offset has
_SAMPLING_STREAM = 1  # stream of random numbers for sampling


class Pipeline:
    """Track, predict every distinct track, then reduce the samples to the number allowed.

    The single-hypothesis pipeline (STP) and the multi-hypothesis one (MTP) are this
    class with trackers of one and of H hypotheses. The pool of an object holds the
    forecasts of all tracks that stand for it in some hypothesis; a pool that is larger
    than the task's K is reduced by the sampler.

    ``weighting``: "posterior" weighs samples by their hypothesis, "uniform" counts
    hypotheses alike, as in the paper.
    ``min_mass``: an object is reported if hypotheses of at least this total weight hold
    it; 0.5 is "likelier than not".
    ``presence``: probability that a track's object is there, None: certain. An object's
    confidence is its mean over the hypotheses by their weight, 0 in those that do not
    hold the object.
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
        self._tracker = tracker
        self._predictor = predictor
        self._sampler = sampler
        self._uniform = weighting == "uniform"
        self._min_mass = min_mass
        self._presence = presence

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        self._frame_number = 0
        self._latest: deque[Observation] = deque(maxlen=task.past)
        self._tracker.reset(task)
        self._predictor.reset(task)
        if self._presence is not None:
            self._presence.reset(task)

    def act(self, observation: Observation) -> Action:
        """Answer one frame."""
        if self._task.after_hole(observation):
            self._latest.clear()
        # copies, since the env may use its arrays again
        copies = {name: np.copy(value) for name, value in observation.items()}
        self._latest.append(copies)
        action = self._make_action(self._tracker.step(observation))
        self._frame_number += 1
        return action

    def _make_action(self, tracks: Tracks) -> Action:
        task = self._task
        objects = group(tracks, task.objects, self._min_mass)
        used_tracks, leaf = _used_tracks(tracks, objects)
        frame = Frame(self._frame_number, used_tracks, tuple(self._latest))
        forecasts = self._predictor.predict(frame)
        if not isinstance(forecasts, Forecasts):
            raise ShapeError(
                f"predict returned a {type(forecasts).__name__}, "
                "expected mtp_bench.agent.Forecasts"
            )
        row_of_track = forecasts.rows_of(used_tracks)  # [H, N]
        leaf_row = row_of_track[np.arange(len(row_of_track)), leaf]
        row = np.where(leaf >= 0, leaf_row, -1)  # [O, H]
        log_weight = tracks.log_weight
        if self._uniform:
            log_weight = np.zeros(len(log_weight))
        pools = make_pools(row, log_weight)
        seed = [task.seed, self._frame_number + 1, _SAMPLING_STREAM]
        rng = np.random.default_rng(seed)
        samples, sample_log_weight = reduce_pools(
            pools, forecasts, task, self._sampler, rng
        )
        confidence = self._confidence(used_tracks, leaf, forecasts.presence, row)
        if forecasts.present is not None:
            objects = _with_centres(objects, row, forecasts.present)
        # a predictor may leave tracks without a forecast
        has_forecast = np.asarray(np.isfinite(sample_log_weight).any(axis=1))
        if not has_forecast.all():
            objects = select(objects, has_forecast)
            samples = samples[has_forecast]
            sample_log_weight = sample_log_weight[has_forecast]
            confidence = confidence[has_forecast]
        for axis in range(2):
            samples[..., axis] -= objects.box[:, None, None, axis]
        return make_action(
            task,
            objects.box,
            objects.class_id,
            _within_limit(samples),
            sample_log_weight,
            confidence=confidence,
            tracks=tracks,
            checked=False,
        )

    def _confidence(
        self, tracks: Tracks, leaf: Ints, presence: Floats | None, row: Ints
    ) -> Floats:
        """Return the confidence [O]: mean presence over the hypotheses by their weight.

        ``leaf`` [O, H]: the track of each object in each hypothesis; ``presence`` [R]:
        of rows of forecasts, ``row`` [O, H] for each object; None: the presence model
        gives that of tracks.
        """
        if presence is None:
            row = leaf
            if self._presence is None:
                presence = np.ones(len(tracks.box))
            else:
                presence = self._presence.probability(tracks, self._latest[-1])
        # a hypothesis that does not hold the object has row -1
        by_hypothesis = np.append(presence, 0.0)[row]
        mean = by_hypothesis @ np.exp(tracks.log_weight)
        return np.asarray(np.minimum(mean, 1.0))


def _used_tracks(tracks: Tracks, objects: Objects) -> tuple[Tracks, Ints]:
    """Return the tracks that stand for objects, and each object's [O, H].

    The latter are rows of the former, -1 for an object without one in the hypothesis.
    """
    used = np.zeros(len(tracks.box) + 1, dtype=bool)  # -1 (no track) marks the last one
    used[objects.leaf] = True
    rows = np.flatnonzero(used[:-1])
    if len(rows) == len(tracks.box):
        return tracks, objects.leaf
    new_row = np.full(len(used), -1)
    new_row[rows] = np.arange(len(rows))
    return tracks.select(rows), new_row[objects.leaf]


def _with_centres(objects: Objects, row: Ints, present: Floats) -> Objects:
    """Put the objects where the forecasts of their heaviest hypothesis begin."""
    # hypotheses are sorted by falling weight
    first = (row >= 0).argmax(axis=1)
    heaviest = row[np.arange(len(row)), first]
    box = np.concatenate([present[heaviest], objects.box[:, 2:]], axis=1)
    return replace(objects, box=box)


def _within_limit(offset: Floats) -> Floats:
    """Shorten offsets [..., 2] of impossibly fast tracks to the limit."""
    if (np.abs(offset) <= FORECAST_REACH).all():
        return offset
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    shortened = offset * (_BELOW_LIMIT * FORECAST_LIMIT / np.maximum(length, 1))
    return np.where(length > FORECAST_LIMIT, shortened, offset)


class Pools(NamedTuple):
    """Rows of `Forecasts` by object: E entries, the entries of one object after another.

    A row has one entry however many hypotheses hold it. Most objects have one entry;
    the sampler is for the others.
    """

    start: Ints  # [O + 1] first entry of each object
    row: Ints  # [E]
    hypothesis: Ints  # [E] the heaviest hypothesis that holds the row
    log_mass: Floats  # [E] log of the total weight of the hypotheses that hold the row


def make_pools(row: Ints, log_weight: Floats) -> Pools:
    """Pool the rows of each of O objects over its hypotheses.

    ``row`` [O, H]: row of each object in each hypothesis, -1 if it has none.
    ``log_weight`` [H]: log-weights of the hypotheses.
    """
    owner, hypothesis = np.nonzero(row >= 0)
    entry_row = row[owner, hypothesis]
    key = owner * (entry_row.max(initial=0) + 1) + entry_row
    # hypotheses are sorted by falling weight, and the sort is stable: among equal
    # entries the one of the heaviest hypothesis comes first
    order = np.argsort(key, kind="stable")
    key = key[order]
    hypothesis = hypothesis[order]
    # the slice: without entries there is no first one
    is_first = np.append(True, key[1:] != key[:-1])[: len(key)]
    first = np.flatnonzero(is_first)
    start = np.searchsorted(owner[order][first], np.arange(len(row) + 1))
    # as logarithms: an object of very unlikely hypotheses must not come to a mass of 0
    log_mass = log_weight[hypothesis]
    if len(first):
        log_mass = np.logaddexp.reduceat(log_mass, first)
    return Pools(start, entry_row[order][first], hypothesis[first], log_mass)


def reduce_pools(
    pools: Pools,
    forecasts: Forecasts,
    task: Task,
    sampler: Sampler,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Return samples [O, K, T, 2] and log-weights [O, K] of the objects.

    Samples that do not exist have the log-weight -inf. Only objects with more than K
    samples go through the sampler.
    """
    per_row, frames = forecasts.samples.shape[1:3]  # samples per row
    sample_log_weight = normalised(forecasts)
    pool_size = np.diff(pools.start) * per_row
    samples = np.zeros((len(pool_size), task.samples, frames, 2))
    log_weight = np.full(samples.shape[:2], -np.inf)
    fits = pool_size <= task.samples
    entry, owner, place = _entries(pools.start, fits)
    row = forecasts.row
    if row is not None and np.ndim(row) == 2 and len(row) * per_row <= task.samples:
        # where all fit, samples of a hypothesis have the same places in all objects
        place = pools.hypothesis[entry]
    slot = place[:, None] * per_row + np.arange(per_row)
    entry_row = pools.row[entry]
    entry_weight = sample_log_weight[entry_row] + pools.log_mass[entry][:, None]
    samples[owner[:, None], slot] = forecasts.samples[entry_row]
    log_weight[owner[:, None], slot] = entry_weight
    large_objects = np.flatnonzero(~fits)
    table_row, log_mass = entry_table(pools, large_objects)
    objects_per_call = max(1, _SAMPLES_PER_CALL // max(table_row.shape[1] * per_row, 1))
    for first in range(0, len(large_objects), objects_per_call):
        part = slice(first, first + objects_per_call)
        pool = padded(
            forecasts.samples, sample_log_weight, table_row[part], log_mass[part]
        )
        reduced = sampler.reduce(*pool, task.samples, rng)
        samples[large_objects[part]], log_weight[large_objects[part]] = reduced
    return samples, log_weight


def normalised(forecasts: Forecasts) -> Floats:
    """Scale log-weights [R, S] so that the weights of each row sum to 1.

    Without log-weights all are 0, and without a forecast all of a row are -inf.
    """
    if forecasts.log_weight is None:
        return np.zeros(forecasts.samples.shape[:2])
    total = np.logaddexp.reduce(forecasts.log_weight, axis=1, keepdims=True)
    has_forecast = np.isfinite(total)
    scaled = forecasts.log_weight - np.where(has_forecast, total, 0.0)
    return np.where(has_forecast, scaled, -np.inf)


def _entries(start: Ints, mask: Bools) -> tuple[Ints, Ints, Ints]:
    """Return the entries of masked objects, their owners and places.

    The place is that among the owner's entries.
    """
    count = np.where(mask, np.diff(start), 0)
    owner, place = in_groups(count)
    return start[owner] + place, owner, place


def entry_table(pools: Pools, objects: Ints) -> tuple[Ints, Floats]:
    """Return rows [o, E] and log-masses [o, E] of the entries of o objects.

    ``objects`` [o]: their numbers, ascending. Missing entries have row 0 and log-mass
    -inf.
    """
    mask = np.zeros(len(pools.start) - 1, dtype=bool)
    mask[objects] = True
    entry, owner, place = _entries(pools.start, mask)
    table_row = np.searchsorted(objects, owner)
    row = np.zeros((len(objects), place.max(initial=-1) + 1), dtype=np.int64)
    log_mass = np.full(row.shape, -np.inf)
    row[table_row, place] = pools.row[entry]
    log_mass[table_row, place] = pools.log_mass[entry]
    return row, log_mass


def padded(
    samples: Floats, sample_log_weight: Floats, row: Ints, log_mass: Floats
) -> tuple[Floats, Floats]:
    """Return samples [o, S, T, 2] and log-weights [o, S] of pools.

    ``samples`` and ``sample_log_weight``: those of rows of forecasts. ``row`` and
    ``log_mass`` [o, E]: row and log-mass of each entry of a pool.
    """
    pools = len(row)
    pool = samples.take(row, axis=0).reshape(pools, -1, *samples.shape[2:])
    log_weight = sample_log_weight[row] + log_mass[:, :, None]
    return pool, log_weight.reshape(pools, -1)
