"""The usual agent: a tracker, a predictor and a sampler."""

from collections import deque
from dataclasses import replace

import numpy as np

from ..env.action import FORECAST_LIMIT
from ..env.building import make_action
from ..errors import ShapeError
from ..tracks import Objects, Tracks, group
from ..types import Action, Floats, Ints, Observation, Task, select
from .pools import make_pools, reduce_pools
from .protocols import Forecasts, Frame, Predictor, Presence, Sampler, Tracker


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
            raise ShapeError(f"weighting is {weighting!r}, expected 'posterior' or 'uniform'")
        if not 0 <= min_mass <= 1:
            raise ShapeError(f"min_mass is {min_mass!r}, expected a weight from 0 to 1")
        self._tracker, self._predictor, self._sampler = tracker, predictor, sampler
        self._uniform, self._min_mass, self._presence = weighting == "uniform", min_mass, presence

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
        """The action of one frame."""
        objects = group(tracks, self._task.objects, self._min_mass)
        used, leaf = _used_tracks(tracks, objects)
        forecasts = self._predictor.predict(Frame(self._number, used, tuple(self._seen)))
        if not isinstance(forecasts, Forecasts):
            raise ShapeError(f"predict returned a {type(forecasts).__name__}, expected mtp_bench.agent.Forecasts")
        row = forecasts.rows_of(used)
        row = np.where(leaf >= 0, row[np.arange(len(row)), leaf], -1)  # [O, H]
        log_weight = np.zeros(len(tracks.log_weight)) if self._uniform else tracks.log_weight
        rng = np.random.default_rng([self._task.seed, self._number + 1, 1])
        samples, weight = reduce_pools(make_pools(row, log_weight), forecasts, self._task, self._sampler, rng)
        confidence = self._confidence(used, leaf, forecasts.presence, row)
        if forecasts.present is not None:
            heaviest = np.take_along_axis(row, (row >= 0).argmax(axis=1)[:, None], axis=1)[:, 0]
            box = np.concatenate([forecasts.present[heaviest], objects.box[:, 2:]], axis=1)
            objects = replace(objects, box=box)
        known = np.asarray(np.isfinite(weight).any(axis=1))  # a predictor may leave tracks without a forecast
        if not known.all():
            objects, samples, weight, confidence = (
                select(objects, known), samples[known], weight[known], confidence[known]
            )  # fmt: skip
        box, kind = objects.box, objects.class_id
        offset = _within_limit(samples - box[:, None, None, :2])
        return make_action(self._task, box, kind, offset, weight, confidence=confidence, tracks=tracks, checked=False)

    def _confidence(self, tracks: Tracks, leaf: Ints, presence: Floats | None, row: Ints) -> Floats:
        """Confidence [O]: mean presence over the hypotheses by their weight.

        ``leaf`` [O, H]: the track of each object in each hypothesis; ``presence`` [R]: of rows of forecasts, ``row``
        [O, H] for each object; None: the presence model gives that of tracks.
        """
        if presence is None:
            presence = np.ones(len(tracks.box))
            if self._presence is not None:
                presence = self._presence.probability(tracks, self._seen[-1])
            row = leaf
        held = np.append(presence, 0.0)[row]  # a hypothesis that does not hold the object has row -1
        return np.asarray(np.minimum(held @ np.exp(tracks.log_weight), 1.0))


def _used_tracks(tracks: Tracks, objects: Objects) -> tuple[Tracks, Ints]:
    """The tracks that stand for an object, and the one of each object in each hypothesis [O, H], -1: none."""
    used = np.unique(objects.leaf)
    used = used[used >= 0]
    if len(used) == len(tracks.box):
        return tracks, objects.leaf
    place = np.full(len(tracks.box) + 1, -1)  # the last one is of "none"
    place[used] = np.arange(len(used))
    return tracks.select(used), place[objects.leaf]


def _within_limit(offset: Floats) -> Floats:
    """Offsets [..., 2], shortened to just below the limit of an action: a wrong track may be that fast."""
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    shortened = offset * (0.999 * FORECAST_LIMIT / np.maximum(length, 1))
    return np.asarray(np.where(length > FORECAST_LIMIT, shortened, offset))
