"""Score of one scene: arrays per target and counts, to be sent between processes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, RolloutError, Scene
from .bade import Cuts, fixed_parts
from .events import separated_tracks, separated_truth
from .forecasts import (
    Candidates,
    ForecastErrors,
    IncrementalMatching,
    RecordedForecasts,
    cuts,
    match_by_confidence,
)
from .lineage import hypotheses, in_all, lineage_events, match_hypotheses
from .matching import Matched
from .statistics import ratio
from .stream import StreamCounts, stream_counts
from .targets import (
    absent_causes,
    count_holes,
    evaluated,
    find_targets,
    live_frames,
    units,
)

_MAX = np.finfo(np.float64).max
_GRID_M = 1e7  # between two frames or classes, where all are searched at once
KINDS = ("ids", "lost", "wrong", "reacquired")


class Outcome(IntEnum):
    """The result of matching a forecast."""

    FALSE_POSITIVE = 0
    NEUTRAL = 1  # at a neutral place or of a neutral object
    NON_TARGET = 2  # of a true object that is not a target
    TARGET = 3


@dataclass(frozen=True, eq=False)
class SceneScore(ForecastErrors):
    """Score of one rollout of one scene.

    Arrays over targets are in the order of `find_targets`.
    """

    scene: str
    # that the scene is cut from, within which objects keep their ids; its own name if
    # it is whole
    recording: str
    frames: int
    live: int  # number of live frames
    has_tracks: bool  # the rollout states a track in any frame
    hypotheses: int  # largest number stated in a frame
    samples: int  # K
    truth_complete: bool
    detections: str  # the detector, in words
    classes: tuple[str, ...]
    units: int  # number of units of resampling in the scene
    unit: Ints  # [n] index of the target's unit in the scene
    frame: Ints  # [n]
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    distance: Floats  # [n] m to the ego
    approach: Floats  # [n] m, nearest to the ego in the future
    moving: Bools  # [n]
    turning: Bools  # [n]
    miss_error: Floats  # [n] m, c
    # [n] m, min(min_ade, c), c where not covered; every forecast is kept
    capped: Floats
    # [n] values of `AbsentCause`, whether it has a forecast or not
    absent_cause: Ints
    own_ids: Bools  # [n] along the lineage of the best hypothesis
    own_frag: Bools  # [n] lost or reacquired
    all_h_ids: Bools  # [n] in every hypothesis
    all_h_frag: Bools  # [n]
    # on all evaluated true boxes, targets or not, by KINDS; "wrong" are among "lost"
    own_events: dict[str, int]
    # frames whose lineage was guessed, since the agent does not state it
    guessed_parents: int
    cuts: Cuts  # cuts by the confidence of the forecasts in live frames
    score_cuts: Cuts  # the same by the score of the nearest detection
    outcome: Ints  # [A] values of `Outcome`, in the order of ``cuts``
    final_error: Floats  # [A] m, minFDE of forecasts of targets, else inf
    fixed_error: float  # m, error at the fixed operating point, summed over targets
    counts: StreamCounts
    invalid: Ints  # [3] rows rejected: tracks, hypotheses, objects
    dropped: int  # detections that did not fit into the observation
    # rows of the scene that could not be read, by reason; holes in time and their
    # targets
    skipped: dict[str, int]
    # per frame, mean without the first frame, in which agents start, unless it is the
    # only one
    seconds: float

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def centred(self) -> Floats:
        """Error ``capped`` [n], m, after a shift of the forecasts.

        Each forecast is shifted so that it begins at the true present position.
        """
        return np.minimum(self.centred_ade, self.miss_error)

    @property
    def forecasts(self) -> int:
        """Number of forecasts in live frames."""
        return len(self.outcome)

    @property
    def false_forecasts(self) -> int:
        """Number of false forecasts in live frames."""
        return int((self.outcome == Outcome.FALSE_POSITIVE).sum())


def score_scene(scene: Scene, rollout: Rollout, card: Card) -> SceneScore:
    """Score ``rollout`` of ``scene`` under the rules of ``card``.

    Raises RolloutError as `check_rollout`.
    """
    check_rollout(scene, rollout, card)
    scene = evaluated(scene)
    truth = separated_truth(scene, card)
    targets = find_targets(scene, card)
    live = live_frames(scene, card)
    forecasts = RecordedForecasts.of(rollout)
    candidates = Candidates.of(scene, targets, forecasts, live, card)
    matching = match_by_confidence(candidates, forecasts.confidence)
    errors, object_of_truth = candidates.final_errors(matching)
    outcome, final_error = _outcomes(candidates, matching, object_of_truth, errors)
    class_miss_error = np.asarray(card.per_class(card.task.miss_error))
    miss_error = class_miss_error[targets.class_id]
    scene_cuts = cuts(candidates, matching, forecasts.confidence, miss_error)
    score = nearest_score(scene, forecasts)
    score_matching = match_by_confidence(candidates, score)
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(truth, rollout, lineage.member, card)
    events = lineage_events(truth, rollout, lineage, matched, scene.annotated_frames)
    best_events = events.of(lineage.best[truth.frame_of_rows])
    unit = units(scene, card)
    hypothesis_count = np.isfinite(rollout.hypothesis_log_weight).sum(axis=1)
    malformed = rollout.malformed * live[:, None]
    fixed, _, false_cost, broken_cost = fixed_parts(
        scene_cuts, malformed, class_miss_error, scene.truth_complete
    )
    tracks = separated_tracks(rollout, scene, card)
    seconds = rollout.seconds[1:] if len(rollout.seconds) > 1 else rollout.seconds
    return SceneScore(
        scene=scene.name,
        recording=scene.recording or scene.name,
        frames=scene.frames,
        live=int(live.sum()),
        has_tracks=len(rollout.track_id) > 0,
        hypotheses=int(hypothesis_count.max(initial=0)),
        samples=rollout.forecast.shape[1],
        truth_complete=scene.truth_complete,
        detections=scene.detector,
        classes=card.task.classes,
        units=int(unit.max(initial=0)) + 1,
        unit=unit[targets.frame],
        frame=targets.frame,
        object_id=targets.object_id,
        class_id=targets.class_id,
        distance=targets.distance,
        approach=targets.approach,
        moving=targets.moving,
        turning=targets.turning,
        miss_error=miss_error,
        **vars(errors),
        capped=np.minimum(errors.min_ade, miss_error),
        absent_cause=absent_causes(scene, targets, card),
        own_ids=best_events.ids[targets.row, 0],
        own_frag=best_events.frag[targets.row, 0],
        all_h_ids=in_all(truth, lineage, events, "ids")[targets.row],
        all_h_frag=in_all(truth, lineage, events, "frag")[targets.row],
        own_events={kind: int(getattr(best_events, kind).sum()) for kind in KINDS},
        guessed_parents=lineage.guessed,
        cuts=scene_cuts,
        score_cuts=cuts(candidates, score_matching, score, miss_error),
        outcome=outcome,
        final_error=final_error,
        fixed_error=float(fixed.sum()) + false_cost + broken_cost,
        counts=stream_counts(replace(scene, truth=truth), tracks, lineage, card),
        invalid=np.asarray(rollout.invalid).sum(axis=0),
        dropped=int(np.asarray(rollout.dropped).sum()),
        skipped=scene.skipped | count_holes(scene, card),
        seconds=float(seconds.sum() / max(len(seconds), 1)),
    )


def mean_plain_error(scores: Sequence[SceneScore]) -> float | None:
    """Return the mean plain error over the targets of some scenes, m.

    None without a target.
    """
    total = sum(float(score.capped.sum()) for score in scores)
    return ratio(total, sum(len(score) for score in scores))


def nearest_score(scene: Scene, forecasts: RecordedForecasts) -> Floats:
    """Return the score [S] of the nearest detection of each forecast.

    The detection has the same frame and class; its score is mapped to (-1, 1), and is
    -1 without a detection. In place of the agent's own confidence this score shows how
    much that confidence is worth (docs/definitions, "Controls, and the gap closed").
    """
    from scipy.spatial import KDTree

    detections = scene.detections
    if not len(detections.box) or not len(forecasts.frame):
        return np.full(len(forecasts.frame), -1.0)
    tree = KDTree(
        _grid_points(detections.box, detections.frame_of_rows, detections.class_id)
    )
    distance, nearest = tree.query(
        _grid_points(forecasts.box, forecasts.frame, forecasts.class_id)
    )
    score = detections.score[nearest]
    return np.where(distance < _GRID_M / 2, score / (1.0 + np.abs(score)), -1.0)


def _grid_points(box: Floats, frame: Ints, class_id: Ints) -> Floats:
    return np.column_stack([box[:, :2], _GRID_M * frame, _GRID_M * class_id])


def _outcomes(
    candidates: Candidates,
    matching: IncrementalMatching,
    object_of_truth: Matched,
    errors: ForecastErrors,
) -> tuple[Ints, Floats]:
    """Return outcome and minFDE of the forecasts in live frames [A], as added."""
    outcome = np.where(matching.false, Outcome.FALSE_POSITIVE, Outcome.NEUTRAL)
    final_error = np.full(len(outcome), np.inf)
    outcome[object_of_truth[object_of_truth >= 0]] = Outcome.NON_TARGET
    column = object_of_truth[candidates.targets.row]
    covered = column >= 0
    outcome[column[covered]] = Outcome.TARGET
    final_error[column[covered]] = errors.min_fde[covered]
    return outcome[matching.order], final_error[matching.order]


def check_rollout(scene: Scene, rollout: Rollout, card: Card) -> None:
    """Raise RolloutError for a rollout of another scene or card.

    Also for values that no env records: a file of rollouts may have been edited.
    """
    where = f"rollout of scene {rollout.scene!r}"
    classes = len(card.task.classes)
    sizes = {
        "name of the scene": (rollout.scene, scene.name),
        "number of frames": (rollout.frames, scene.frames),
        "number of future frames": (rollout.forecast.shape[2], card.task.future),
        "number of classes": (rollout.malformed.shape[1] - 1, classes),
    }
    for size_name, (size, expected_size) in sizes.items():
        if size != expected_size:
            raise RolloutError(
                f"{where}: the {size_name} is {size!r}, expected {expected_size!r}; "
                "was it run on another card?"
            )
    last_class = classes - 1
    last_parent = rollout.hypothesis_parent.shape[1] - 1
    ranges = {
        "track_box": (-_MAX, _MAX, "finite numbers"),
        # -1: not stated, fits every class
        "track_class": (-1, last_class, f"-1 to {last_class}"),
        "hypothesis_parent": (-1, last_parent, f"-1 to {last_parent}"),
        "object_box": (-_MAX, _MAX, "finite numbers"),
        "object_class": (0, last_class, f"0 to {last_class}"),
        "object_confidence": (0, 1, "values in [0, 1]"),
        "invalid": (0, _MAX, "0 or more"),
        "malformed": (0, _MAX, "0 or more"),
        "dropped": (0, _MAX, "0 or more"),
        "seconds": (0, _MAX, "a finite time of 0 s or more"),
    }
    for name, (low, high, expected) in ranges.items():
        array = np.asarray(getattr(rollout, name))
        outside = ~((array >= low) & (array <= high))  # NaN is outside
        if outside.any():
            frame = int(np.argwhere(outside)[0][0])
            if name.startswith("track_"):
                frame = rollout.tracks.frame_of_rows[frame]
            elif name.startswith("object_"):
                frame = rollout.objects.frame_of_rows[frame]
            raise RolloutError(
                f"{where}: {name} contains {array[outside][0]} (frame {frame}); "
                f"expected {expected}"
            )
