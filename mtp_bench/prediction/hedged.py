"""One hypothesis, several readings of its past: the control that costs nothing (protocol, "Controls")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..agent import FramePredictor, SamplingPredictor, Tracks
from ..errors import ShapeError, SubmissionError
from ..types import Floats, Ints, Task


class StandingStill:
    """The object stays where it was last seen."""

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._future = task.future

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """The last position, repeated: [Q, samples, T, 2]."""
        here = tracks.past[leaf, -1, :2][:, None, None, :]
        return np.broadcast_to(here, (len(leaf), samples, self._future, 2)).copy()


class HedgedPredictor:
    """Spreads the samples evenly over several predictors; the first ones get what is left over.

    Args:
        predictors: They share the samples. Each gets random draws of its own: two that read the same past say
            different things.
        once: Predictors that have one thing to say, such as `StandingStill`: one sample each, after the others.

    Raises ShapeError without predictors, SubmissionError for one that draws no samples.
    """

    def __init__(self, predictors: Sequence[SamplingPredictor], once: Sequence[SamplingPredictor] = ()) -> None:
        self._shared, self._once = tuple(predictors), tuple(once)
        self._predictors = (*self._shared, *self._once)
        if not self._shared:
            raise ShapeError("HedgedPredictor got no predictors, expected at least one")
        for place, predictor in enumerate(self._predictors):
            if isinstance(predictor, type) or not callable(getattr(predictor, "sample", None)):
                kind = type(predictor).__name__
                got = f"the class {predictor.__name__}" if isinstance(predictor, type) else f"a {kind}"
                raise SubmissionError(
                    f"HedgedPredictor got {got} as predictor {place}, expected one that draws samples, "
                    "with sample(tracks, leaf, draw, samples), such as KinematicPredictor(); one with predict(frame) "
                    "goes into a Pipeline by itself"
                )

    def reset(self, task: Task) -> None:
        """Forget everything."""
        for predictor in self._predictors:
            predictor.reset(task)

    def begin(self, tracks: Tracks) -> None:
        """The next frame, for the predictors that want to know."""
        for predictor in self._predictors:
            if isinstance(predictor, FramePredictor):
                predictor.begin(tracks)

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y, in the order of the predictors."""
        count = len(self._shared)
        single = min(len(self._once), samples - 1)
        share, rest = divmod(samples - single, count)
        sizes = [share + (i < rest) for i in range(count)]
        parts = [
            predictor.sample(tracks, leaf, draw * count + i, size)
            for i, (predictor, size) in enumerate(zip(self._shared, sizes, strict=True))
            if size
        ]
        parts += [predictor.sample(tracks, leaf, draw, 1) for predictor in self._once[:single]]
        return np.concatenate(parts, axis=1)
