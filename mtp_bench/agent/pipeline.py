"""The usual agent: tracker, then predictor, then sampler."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ..env.action import FORECAST_LIMIT
from ..env.building import make_action
from ..errors import ShapeError
from ..tracks import Objects, Tracks, group
from ..types import Action, Floats, Ints, Observation, Task, those
from .pools import pool_of, reduced
from .protocols import Forecasts, Frame, FramePredictor, Predictor, Presence, Sampler, SamplingPredictor, Tracker

_POOLED = 2048  # samples that are held at once: memory must not grow with hypotheses times objects


class _Said(NamedTuple):
    """What is answered of O objects."""

    objects: Objects
    samples: Floats  # [O, K, T, 2] absolute x y
    log_weight: Floats  # [O, K]
    confidence: Floats  # [O]


class Pipeline:
    """Track, then predict every distinct track, then reduce to the samples allowed.

    The single-hypothesis pipeline (STP) and the multi-hypothesis one (MTP) are this class with trackers of one and of
    H hypotheses. To the pool of an object each hypothesis contributes ``draws`` x k random draws, or each distinct
    track once what is predicted of it; a pool that is larger than the task's K is reduced by the sampler.

    ``tracker``: what makes tracks of detections. ``predictor``: what forecasts them: all of a frame at once with
    log-weights (`Predictor`), or by random draws (`SamplingPredictor`). ``sampler``: what reduces pools.

    ``weighting``: "posterior" weighs samples by their hypothesis, "uniform" counts hypotheses alike, as in the paper.
    ``min_mass``: an object is reported if hypotheses of at least this total weight hold it; 0.5 is "likelier than not".
    ``presence``: how likely it is that a track's object is there, None: certain. An object's confidence is its mean
    over the hypotheses by their weight, 0 in those that do not hold the object.
    """

    def __init__(
        self,
        tracker: Tracker,
        predictor: Predictor | SamplingPredictor,
        sampler: Sampler,
        draws: int = 1,
        weighting: str = "posterior",
        min_mass: float = 0.5,
        presence: Presence | None = None,
    ) -> None:
        if weighting not in ("posterior", "uniform"):
            raise ShapeError(f"weighting is {weighting!r}, expected 'posterior' or 'uniform'")
        if isinstance(draws, bool) or not isinstance(draws, int | np.integer) or draws < 1:
            raise ShapeError(f"draws is {draws!r}, expected a whole number of at least 1")
        if not 0 <= min_mass <= 1:
            raise ShapeError(f"min_mass is {min_mass!r}, expected a weight from 0 to 1")
        self._tracker, self._predictor, self._sampler = tracker, predictor, sampler
        self._draws = draws
        self._posterior = weighting == "posterior"
        self._min_mass, self._presence = min_mass, presence
        self.seconds = {"tracking": 0.0, "prediction": 0.0}  # of the last frame

    def reset(self, task: Task) -> None:
        """Forget everything; a new scene begins."""
        self._task = task
        self._frame = 0
        self._seen: deque[Observation] = deque(maxlen=task.past)
        self._tracker.reset(task)
        self._predictor.reset(task)
        if self._presence is not None:
            self._presence.reset(task)

    def act(self, observation: Observation) -> Action:
        """Answer one frame."""
        self._frame += 1
        self._seen.append({name: np.copy(value) for name, value in observation.items()})  # its arrays may be used again
        started = perf_counter()
        tracks = self._tracker.step(observation)
        tracked = perf_counter()
        objects = group(tracks, self._task.objects, self._min_mass)
        rng = np.random.default_rng([self._task.seed, self._frame, 1])
        if isinstance(self._predictor, Predictor):
            said = self._predicted(self._predictor, tracks, objects, rng)
        else:
            said = self._drawn(self._predictor, tracks, objects, rng)
        objects = said.objects
        action = make_action(
            self._task,
            objects.box,
            objects.class_id,
            _within_limit(said.samples - objects.box[:, None, None, :2]),
            said.log_weight,
            confidence=said.confidence,
            tracks=tracks,
            checked=False,
        )
        self.seconds = {"tracking": tracked - started, "prediction": perf_counter() - tracked}
        return action

    def _predicted(self, predictor: Predictor, tracks: Tracks, objects: Objects, rng: np.random.Generator) -> _Said:
        """What a predictor says that is asked once per frame, for the tracks that stand for an object."""
        needed, leaf = np.unique(objects.leaf, return_inverse=True)
        first = int(np.searchsorted(needed, 0))  # -1, "holds none", comes before all tracks
        leaf = leaf.reshape(objects.leaf.shape) - first
        part = tracks.those(needed[first:])
        said = predictor.predict(Frame(self._frame - 1, part, tuple(self._seen)))
        if not isinstance(said, Forecasts):
            raise ShapeError(f"predict returned a {type(said).__name__}, expected mtp_bench.agent.Forecasts")
        row = np.append(said.rows_of(len(part.box)), -1)[leaf]
        log_weight = tracks.log_weight if self._posterior else np.zeros(len(tracks.log_weight))
        samples, weight = reduced(pool_of(row, log_weight), said, self._task, self._sampler, rng, _POOLED)
        if said.presence is None:
            confidence = self._confidence(self._probability(part), leaf, tracks)
        else:
            confidence = self._confidence(said.presence, row, tracks)
        if said.present is not None:
            heaviest = np.take_along_axis(row, (row >= 0).argmax(axis=1)[:, None], axis=1)[:, 0]
            objects = replace(objects, box=np.concatenate([said.present[heaviest], objects.box[:, 2:]], axis=1))
        return _without_silent(_Said(objects, samples, weight, confidence))

    def _drawn(self, predictor: SamplingPredictor, tracks: Tracks, objects: Objects, rng: np.random.Generator) -> _Said:
        """What a predictor says of which samples are drawn: as many of a track as there are hypotheses holding it."""
        if isinstance(predictor, FramePredictor):
            predictor.begin(tracks)
        size = objects.leaf.shape[1] * self._draws * self._task.k
        at_once = max(1, _POOLED // max(size, 1))
        parts = [
            self._forecast(predictor, tracks, objects.leaf[first : first + at_once], rng)
            for first in range(0, max(len(objects.leaf), 1), at_once)
        ]
        samples, log_weight = (np.concatenate(part) for part in zip(*parts, strict=True))
        return _Said(objects, samples, log_weight, self._confidence(self._probability(tracks), objects.leaf, tracks))

    def _probability(self, tracks: Tracks) -> Floats:
        """Probability [N] that the objects of tracks are there."""
        if self._presence is None:
            return np.ones(len(tracks.box))
        return self._presence.probability(tracks, self._seen[-1])

    def _confidence(self, probability: Floats, held: Ints, tracks: Tracks) -> Floats:
        """Confidence [O]: the mean over hypotheses, by their weight, of the probability of what they hold [O, H]."""
        present = np.append(probability, 0.0)[held]  # a hypothesis that holds none has -1
        return np.asarray(np.minimum(present @ np.exp(tracks.log_weight), 1.0))

    def _forecast(
        self, predictor: SamplingPredictor, tracks: Tracks, leaf: Ints, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """Samples [O, K, T, 2] and log-weights [O, K] of objects that hypotheses hold as the tracks ``leaf`` [O, H]."""
        every = np.arange(leaf.shape[1])
        if len(every) * self._draws * self._task.k <= self._task.samples:
            return self._pool(predictor, tracks, leaf, every)
        pool, log_weight = self._pool(predictor, tracks, leaf, np.flatnonzero((leaf >= 0).any(axis=0)))
        return self._sampler.reduce(pool, log_weight, self._task.samples, rng)

    def _pool(
        self, predictor: SamplingPredictor, tracks: Tracks, leaf: Ints, hypotheses: Ints
    ) -> tuple[Floats, Floats]:
        """All samples of some hypotheses: [O, H x draws x k, T, 2], and their log-weights; -inf where none is."""
        leaf, k, draws = leaf[:, hypotheses], self._task.k, self._draws
        row, column = np.nonzero(leaf >= 0)
        row, place = np.repeat(row, draws), (column[:, None] * draws + np.arange(draws)).ravel()
        slot = (hypotheses[column][:, None] * draws + np.arange(draws)).ravel()
        pool = predictor.sample(tracks, np.repeat(leaf[leaf >= 0], draws), slot, k)
        shape = len(leaf), len(hypotheses) * draws, k
        if len(row) < shape[0] * shape[1]:  # else the samples are the pool already, in its order
            samples, pool = pool, np.zeros((*shape, self._task.future, 2))
            pool[row, place] = samples
        log_weight = np.full(shape, -np.inf)
        weight = tracks.log_weight if self._posterior else np.zeros(len(tracks.log_weight))
        log_weight[row, place] = weight[slot // draws][:, None]
        size = shape[1] * k
        return pool.reshape(shape[0], size, self._task.future, 2), log_weight.reshape(shape[0], size)


def _within_limit(offset: Floats) -> Floats:
    """Offsets [..., 2] that are too long for an answer end just before the limit: a wrong track may be that fast."""
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    return np.asarray(
        np.where(length > FORECAST_LIMIT, offset * (0.999 * FORECAST_LIMIT / np.maximum(length, 1)), offset)
    )


def _without_silent(said: _Said) -> _Said:
    """What is said, without the objects that have no sample at all: a predictor may withhold."""
    spoken = np.asarray(np.isfinite(said.log_weight).any(axis=1))
    if spoken.all():
        return said
    return _Said(those(said.objects, spoken), *(part[spoken] for part in said[1:]))
