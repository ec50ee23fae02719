"""Interface of an agent, and of the parts of a `Pipeline`: tracker, predictor, presence and sampler."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

import numpy as np

from ..core import (
    Action as Action,
    Floats,
    Ints,
    Objects as Objects,
    Observation as Observation,
    ShapeError,
    Task,
    Tracks as Tracks,
)


@runtime_checkable
class Agent(Protocol):
    """An agent answers detections with hypotheses and forecasts, frame by frame."""

    def reset(self, task: Task) -> None:
        """Begin a new scene under the rules of ``task``.

        Forget everything before.
        """

    def act(self, observation: Observation) -> Action:
        """Answer one frame.

        Keys and shapes are as in the env's observation and action space.
        """
        ...


class Tracker(Protocol):
    """A tracker turns the detections of a frame into tracks."""

    def reset(self, task: Task) -> None:
        """Begin a new scene."""

    def step(self, observation: Observation) -> Tracks:
        """Return the tracks after this frame.

        None should cross a hole in time, see `Task.after_hole`.
        """
        ...


@dataclass(frozen=True, eq=False)
class Frame:
    """Input of a predictor: distinct tracks of all hypotheses, latest observations."""

    number: int  # frames before this one in the scene
    tracks: Tracks  # N distinct tracks, with all that the tracker states of them
    # observations of at most the last P frames, without a hole in time, oldest first;
    # the last one is that of this frame
    seen: tuple[Observation, ...]


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Forecasts of the N tracks of a frame in R rows.

    Several tracks may share a row.
    """

    samples: Floats  # [R, S, T, 2] absolute x y, m
    # [R, S]; None: equal; -inf: no such sample; -inf throughout: no forecast
    log_weight: Floats | None = None
    present: Floats | None = None  # [R, 2] x y now; None: the centre of the track's box
    # [R] probability that the object is there; None: ask the pipeline's presence
    presence: Floats | None = None
    # [N] row of each track, or [H, N] of each track in each hypothesis; None: row i is
    # track i
    row: Ints | None = None

    def __post_init__(self) -> None:
        if np.ndim(self.samples) != 4:
            raise ShapeError(
                f"forecasts.samples has shape {np.shape(self.samples)}, expected "
                "[rows, samples, frames, 2]; one sample each is [rows, 1, frames, 2]"
            )
        rows, samples = np.shape(self.samples)[:2]
        expected = {
            "log_weight": (rows, samples),
            "present": (rows, 2),
            "presence": (rows,),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise ShapeError(
                    f"forecasts.{name} has shape {np.shape(value)}, expected {shape}"
                )

    def rows_of(self, tracks: Tracks) -> Ints:
        """Return the row [H, N] of each track in each hypothesis.

        Entries of hypotheses without the track are arbitrary. Raises ShapeError where
        ``row`` does not fit the tracks or the samples.
        """
        rows = len(self.samples)
        hypotheses, n = tracks.member.shape
        if self.row is None:
            if rows != n:
                raise ShapeError(
                    f"forecasts.samples has {rows} rows, expected {n}: "
                    "one for each track, or row"
                )
            return np.broadcast_to(np.arange(n), (hypotheses, n))
        row = np.asarray(self.row)
        if row.shape not in ((n,), (hypotheses, n)):
            raise ShapeError(
                f"forecasts.row has shape {row.shape}, "
                f"expected {(n,)} or {(hypotheses, n)}"
            )
        by_hypothesis = np.broadcast_to(row, (hypotheses, n))
        used_rows = by_hypothesis[tracks.member]
        wrong_rows = used_rows[(used_rows < 0) | (used_rows >= rows)]
        if len(wrong_rows):
            raise ShapeError(
                f"forecasts.row is {wrong_rows[0]}, expected 0 to {rows - 1}: "
                "a row of forecasts.samples"
            )
        return by_hypothesis


class Predictor(Protocol):
    """A predictor forecasts the distinct tracks of a frame."""

    def reset(self, task: Task) -> None:
        """Begin a new scene."""

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the tracks of ``frame``.

        A pipeline calls it once per frame.
        """
        ...


@final
class FunctionPredictor:
    """A predictor made of one function of tracks.

    ``forecast(tracks, task)`` returns samples [N, S, T, 2], absolute x y in metres, of
    equal weight. Objects that stand still, for example: ``lambda tracks, task:
    np.repeat(tracks.past[:, -1:, None, :2], task.future, axis=2)``.
    """

    def __init__(self, forecast: Callable[[Tracks, Task], Floats]) -> None:
        self._forecast = forecast

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the tracks of ``frame``."""
        return Forecasts(self._forecast(frame.tracks, self._task))


class Presence(Protocol):
    """A presence model estimates whether the objects of tracks are really there."""

    def reset(self, task: Task) -> None:
        """Begin a new scene."""

    def probability(self, tracks: Tracks, observation: Observation) -> Floats:
        """Return the probability [N] of each track, from 0 to 1."""
        ...


class Sampler(Protocol):
    """A sampler reduces a pool of samples to the number allowed."""

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """Reduce each pool to ``k`` samples that stand for it.

        ``pool`` [O, S, T, 2] with log-weights [O, S] becomes samples [O, k, T, 2] and
        log-weights [O, k]. A sample with log-weight -inf does not exist. With fewer
        than k samples, return them as they are, or fill up with ones that do not exist.
        """
        ...
