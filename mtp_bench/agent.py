"""What an agent is, and the usual one: tracker, then predictor, then sampler."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from .env.building import answer
from .errors import ShapeError
from .tracks import Objects as Objects
from .tracks import Tracks as Tracks
from .tracks import group
from .types import Action as Action
from .types import Floats, Ints, Task
from .types import Observation as Observation


@runtime_checkable
class Agent(Protocol):
    """Anything that answers detections with hypotheses and forecasts, frame by frame."""

    def reset(self, task: Task) -> None:
        """Forget everything; a new scene begins under the rules of ``task``."""

    def act(self, observation: Observation) -> Action:
        """Answer one frame; keys and shapes as in the env's observation and action space."""
        ...


class Tracker(Protocol):
    """Turns the detections of a frame into tracks."""

    def reset(self, task: Task) -> None:
        """Forget everything."""

    def step(self, observation: Observation) -> Tracks:
        """Tracks to output after this frame."""
        ...


class Predictor(Protocol):
    """Samples futures of tracks."""

    def reset(self, task: Task) -> None:
        """Forget everything."""

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q].

        ``draw`` [Q] numbers the random draws: equal numbers mean equal draws, whatever track they are applied to. The
        tracks of a frame may be asked for in several calls, always with the same ``tracks``.
        """
        ...


@runtime_checkable
class FramePredictor(Predictor, Protocol):
    """A predictor that is told each frame, for what all samples of a frame share; others need no ``begin``."""

    def begin(self, tracks: Tracks) -> None:
        """The next frame has these tracks; called once, before samples of them are asked for."""


class Presence(Protocol):
    """Says how likely it is that the object of a track is really there."""

    def reset(self, task: Task) -> None:
        """Forget everything."""

    def probability(self, tracks: Tracks, observation: Observation) -> Floats:
        """Probability [N] of each track of this frame, from 0 to 1."""
        ...


class Sampler(Protocol):
    """Reduces a pool of samples to the number allowed."""

    def reduce(self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """``k`` samples [O, k, T, 2] and log-weights [O, k] that stand for the pool [O, S, T, 2] weighted [O, S]."""
        ...


_POOLED = 2048  # samples that are held at once: memory must not grow with hypotheses times objects


class Pipeline:
    """Track, then predict every distinct track, then reduce to the samples allowed.

    The single-hypothesis pipeline (STP) and the multi-hypothesis one (MTP) are this class with trackers of one and of
    H hypotheses. Each hypothesis contributes ``draws`` x k samples to the pool of an object; a pool that is larger than
    the task's K is reduced by the sampler.

    ``tracker``: what makes tracks of detections. ``predictor``: what forecasts them. ``sampler``: what reduces pools.

    ``weighting``: "posterior" weighs samples by their hypothesis, "uniform" counts hypotheses alike, as in the paper.
    ``min_mass``: an object is reported if hypotheses of at least this total weight hold it; 0.5 is "likelier than not".
    ``presence``: how likely it is that a track's object is there, None: certain. An object's confidence is its mean
    over the hypotheses by their weight, 0 in those that do not hold the object.
    """

    def __init__(
        self,
        tracker: Tracker,
        predictor: Predictor,
        sampler: Sampler,
        draws: int = 1,
        weighting: str = "posterior",
        min_mass: float = 0.5,
        presence: Presence | None = None,
    ) -> None:
        if weighting not in ("posterior", "uniform"):
            raise ShapeError(f"weighting is {weighting!r}, expected 'posterior' or 'uniform'")
        self._tracker, self._predictor, self._sampler = tracker, predictor, sampler
        self._draws = draws
        self._posterior = weighting == "posterior"
        self._min_mass, self._presence = min_mass, presence
        self.reported: Objects | None = None  # what the last answer said is there

    def reset(self, task: Task) -> None:
        """Forget everything; a new scene begins."""
        self._task = task
        self._frame = 0
        self.reported = None
        self._tracker.reset(task)
        self._predictor.reset(task)
        if self._presence is not None:
            self._presence.reset(task)

    def act(self, observation: Observation) -> Action:
        """Answer one frame."""
        self._frame += 1
        tracks = self._tracker.step(observation)
        if isinstance(self._predictor, FramePredictor):
            self._predictor.begin(tracks)
        objects = group(tracks, self._task.objects, self._min_mass)
        self.reported = objects
        rng = np.random.default_rng([self._task.seed, self._frame, 1])
        size = objects.leaf.shape[1] * self._draws * self._task.k
        at_once = max(1, _POOLED // max(size, 1))
        parts = [
            self._forecast(tracks, objects.leaf[first : first + at_once], rng)
            for first in range(0, max(len(objects.leaf), 1), at_once)
        ]
        samples, log_weight = (np.concatenate(part) for part in zip(*parts, strict=True))
        offset = samples - objects.box[:, None, None, :2]
        return answer(
            self._task,
            objects.box,
            objects.class_id,
            offset,
            log_weight,
            confidence=self._confidence(tracks, objects, observation),
            tracks=tracks,
            checked=False,
        )

    def _confidence(self, tracks: Tracks, objects: Objects, observation: Observation) -> Floats:
        """Confidence [O]: the mean over hypotheses, by their weight, of the presence of what they hold."""
        sure = np.ones(len(tracks.box)) if self._presence is None else self._presence.probability(tracks, observation)
        held = np.append(sure, 0.0)[objects.leaf]  # a hypothesis that holds none has leaf -1
        return np.asarray(np.minimum(held @ np.exp(tracks.log_weight), 1.0))

    def _forecast(self, tracks: Tracks, leaf: Ints, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Samples [O, K, T, 2] and log-weights [O, K] of objects that hypotheses hold as the tracks ``leaf`` [O, H]."""
        every = np.arange(leaf.shape[1])
        if len(every) * self._draws * self._task.k <= self._task.samples:
            return self._pool(tracks, leaf, every)
        pool, log_weight = self._pool(tracks, leaf, np.flatnonzero((leaf >= 0).any(axis=0)))
        return self._sampler.reduce(pool, log_weight, self._task.samples, rng)

    def _pool(self, tracks: Tracks, leaf: Ints, hypotheses: Ints) -> tuple[Floats, Floats]:
        """All samples of some hypotheses: [O, H x draws x k, T, 2], and their log-weights; -inf where none is."""
        leaf, k, draws = leaf[:, hypotheses], self._task.k, self._draws
        row, column = np.nonzero(leaf >= 0)
        row, place = np.repeat(row, draws), (column[:, None] * draws + np.arange(draws)).ravel()
        slot = (hypotheses[column][:, None] * draws + np.arange(draws)).ravel()
        pool = self._predictor.sample(tracks, np.repeat(leaf[leaf >= 0], draws), slot, k)
        shape = len(leaf), len(hypotheses) * draws, k
        if len(row) < shape[0] * shape[1]:  # else the samples are the pool already, in its order
            samples, pool = pool, np.zeros((*shape, self._task.future, 2))
            pool[row, place] = samples
        log_weight = np.full(shape, -np.inf)
        weight = tracks.log_weight if self._posterior else np.zeros(len(tracks.log_weight))
        log_weight[row, place] = weight[slot // draws][:, None]
        size = shape[1] * k
        return pool.reshape(shape[0], size, self._task.future, 2), log_weight.reshape(shape[0], size)
