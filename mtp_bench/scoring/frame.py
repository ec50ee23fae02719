"""Score of single frames, from which a training env takes its reward and metrics."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..cards import Card
from ..core import Ints, Scene
from .bade import fixed_parts
from .forecasts import (
    Candidates,
    RecordedForecasts,
    cuts,
    match_by_confidence,
    target_errors,
)
from .incremental_matching import last_of
from .targets import evaluated, find_targets, live_frames


@dataclass(frozen=True)
class FrameScore:
    """Numbers of one frame or of several.

    The costs are those of `fixed_parts`.
    ``covered``, ``min_ade`` and ``false_forecasts`` keep every forecast, as in a
    `SceneScore`. Where the truth lists prediction targets alone, false forecasts are
    unknown and their number is 0.
    """

    targets: int = 0
    covered: int = 0  # targets with a forecast
    min_ade: float = 0.0  # m, mean over the covered targets; 0 without one
    false_forecasts: int = 0
    # m, of targets without a forecast of confidence 0.5 or more
    cost_missed: float = 0.0
    # m, of false forecasts of such a confidence, and of invalid objects
    cost_false: float = 0.0
    cost_error: float = 0.0  # m, of targets with a forecast of such a confidence

    @property
    def error(self) -> float:
        """Error at the fixed operating point, m."""
        return self.cost_missed + self.cost_false + self.cost_error

    @property
    def reward(self) -> float:
        """The reward, m."""
        return 0.0 - self.error  # not -error: no -0.0

    @classmethod
    def total(cls, frames: Sequence["FrameScore"]) -> "FrameScore":
        """Return sums over ``frames``, and the mean minADE over all covered targets."""
        table = np.array([list(vars(frame).values()) for frame in frames])
        table = table.reshape(-1, len(fields(cls)))  # also without frames
        table[:, 2] *= table[:, 1]  # min_ade times covered: a sum
        targets, covered, ade_sum, false, *costs = table.sum(axis=0).tolist()
        mean_ade = ade_sum / max(covered, 1.0)
        return cls(int(targets), int(covered), mean_ade, int(false), *costs)


class FrameScorer:
    """Scores of the frames of one scene under the rules of ``card``."""

    def __init__(self, scene: Scene, card: Card) -> None:
        self.live = live_frames(scene, card)
        self._card = card
        self._scene = evaluated(scene)
        # evaluated already: without the image
        targets = find_targets(replace(self._scene, image=None), card)
        # `score` sees the truth of one frame
        frame_row = targets.row - scene.truth.start[targets.frame]
        self._targets = replace(targets, row=frame_row)
        self._miss_error = np.asarray(card.per_class(card.task.miss_error))

    def score(
        self, t: int, forecasts: RecordedForecasts, malformed: Ints
    ) -> FrameScore:
        """Score the ``forecasts`` and the invalid objects of frame ``t``.

        ``malformed`` [C + 1]: number of invalid objects by class.
        """
        if not self.live[t]:
            return FrameScore()
        targets = self._targets.only(t)
        scene = replace(self._scene, truth=self._scene.truth.only(t))
        candidates = Candidates.of(scene, targets, forecasts, self.live, self._card)
        matching = match_by_confidence(candidates, forecasts.confidence)
        miss_error = self._miss_error[targets.class_id]
        frame_cuts = cuts(candidates, matching, forecasts.confidence, miss_error)
        malformed_table = np.zeros((scene.frames, len(malformed)), dtype=np.int64)
        malformed_table[t] = malformed
        error, missed, *false_costs = fixed_parts(
            frame_cuts, malformed_table, self._miss_error, scene.truth_complete
        )
        _, target, min_ade = target_errors(candidates, matching)
        final_ade = min_ade[last_of(target)]
        final_ade = final_ade[np.isfinite(final_ade)]
        return FrameScore(
            targets=len(targets),
            covered=len(final_ade),
            min_ade=float(final_ade.mean()) if len(final_ade) else 0.0,
            false_forecasts=int(matching.false.sum()) if scene.truth_complete else 0,
            cost_missed=float(missed.sum()),
            cost_false=sum(false_costs),
            cost_error=float((error - missed).sum()),
        )
