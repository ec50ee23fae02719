"""What an agent is, and the three parts that the usual one is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from ..errors import ShapeError
from ..tracks import Tracks
from ..types import Action, Floats, Ints, Observation, Task


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


@dataclass(frozen=True, eq=False)
class Frame:
    """What a predictor is told of a frame: the distinct tracks of all hypotheses, and what was seen lately."""

    number: int  # frames before this one in the scene
    tracks: Tracks  # N distinct tracks, with their pasts, hits, ages and whatever else the tracker states
    seen: tuple[Observation, ...]  # of the last P frames at most, oldest first; the last one is this frame's


@dataclass(frozen=True, eq=False)
class Forecasts:
    """What a predictor says of the N tracks of a frame, in R rows; a row may stand for several tracks."""

    samples: Floats  # [R, S, T, 2] absolute x y, m
    log_weight: Floats | None = None  # [R, S]; None: all alike; -inf: no such sample; -inf throughout: nothing is said
    present: Floats | None = None  # [R, 2] x y now; None: the centre of the track's box
    presence: Floats | None = None  # [R] probability that the object is there; None: the pipeline's presence says it
    row: Ints | None = None  # [N] the row of each track; None: row i is track i

    def __post_init__(self) -> None:
        if np.ndim(self.samples) != len("RSTx"):
            got = f"forecasts.samples has shape {np.shape(self.samples)}"
            raise ShapeError(f"{got}, expected [rows, samples, frames, 2]; one sample each is [rows, 1, frames, 2]")
        rows, samples = np.shape(self.samples)[:2]
        wanted = {"log_weight": (rows, samples), "present": (rows, 2), "presence": (rows,)}
        for name, shape in wanted.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise ShapeError(f"forecasts.{name} has shape {np.shape(value)}, expected {shape}")

    def rows_of(self, tracks: int) -> Ints:
        """The row [N] of each of so many tracks; raises ShapeError where there is not one for every track."""
        rows = len(self.samples)
        if self.row is None:
            if rows != tracks:
                raise ShapeError(f"forecasts.samples hold {rows} rows, expected {tracks}: one for each track, or row")
            return np.arange(rows)
        row = np.asarray(self.row)
        if row.shape != (tracks,):
            raise ShapeError(f"forecasts.row has shape {row.shape}, expected {(tracks,)}: the row of each track")
        if tracks and not 0 <= row.min() <= row.max() < rows:
            worst = row.max() if row.max() >= rows else row.min()
            raise ShapeError(f"forecasts.row is {worst}, expected 0 to {rows - 1}: a row of forecasts.samples")
        return row


@runtime_checkable
class Predictor(Protocol):
    """Forecasts the distinct tracks of a frame, once per frame."""

    def reset(self, task: Task) -> None:
        """Forget everything."""

    def predict(self, frame: Frame) -> Forecasts:
        """What happens next to the tracks of ``frame``, in absolute x y."""
        ...


class SamplingPredictor(Protocol):
    """Draws futures of single tracks, as many as are asked for: for predictors whose samples are random draws."""

    def reset(self, task: Task) -> None:
        """Forget everything."""

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q].

        ``draw`` [Q] numbers the random draws: equal numbers mean equal draws, whatever track they are applied to. The
        tracks of a frame may be asked for in several calls, always with the same ``tracks``.
        """
        ...


@runtime_checkable
class FramePredictor(SamplingPredictor, Protocol):
    """One that is told each frame, for what all samples of a frame share; others need no ``begin``."""

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
