"""Score of one scene: arrays per target and counts, small enough to send between processes."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, RolloutError, Scene
from .bade import Cuts, capped_error, fixed_error
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
from .neutral import evaluated
from .stream import StreamCounts, stream_counts
from .targets import absent_causes, find_targets, left_out, live_frames, units

_MOST = np.finfo(np.float64).max
KINDS = ("ids", "lost", "wrong", "reacquired")


class Outcome(IntEnum):
    """The result of matching a forecast."""

    FALSE_POSITIVE = 0
    NEUTRAL = 1  # at a neutral place or of a neutral object
    NON_TARGET = 2  # of a true object that is not a target
    TARGET = 3


@dataclass(frozen=True, eq=False)
class SceneScore(ForecastErrors):
    """Score of one rollout of one scene; arrays over targets are in the order of `find_targets`."""

    scene: str
    recording: str  # that the scene is cut from, within which objects keep their ids; its own name if it is whole
    frames: int
    live: int  # number of live frames
    hypotheses: int  # largest number stated in a frame
    samples: int  # K
    truth_complete: bool
    detections: str  # the detector, in words
    classes: tuple[str, ...]
    units: int  # of uncertainty in the scene
    unit: Ints  # [n] index of the target's unit in the scene
    frame: Ints  # [n]
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    distance: Floats  # [n] m to the ego
    approach: Floats  # [n] m, nearest to the ego in the future
    moving: Bools  # [n]
    turning: Bools  # [n]
    miss_error: Floats  # [n] m, c
    capped: (
        Floats  # [n] m, min(min_ade, c), c where not covered; every forecast is kept
    )
    absent_cause: Ints  # [n] values of `AbsentCause`, whether it has a forecast or not
    own_ids: Bools  # [n] along the lineage of the best hypothesis
    own_lost: Bools  # [n]
    own_reacquired: Bools  # [n]
    all_h_ids: Bools  # [n] in every hypothesis
    all_h_frag: Bools  # [n]
    own_events: dict[
        str, int
    ]  # on all evaluated true boxes, targets or not, by KINDS; "wrong" are among the "lost"
    guessed_parents: (
        int  # frames whose lineage was guessed, since the agent does not state it
    )
    cuts: Cuts  # of the forecasts in live frames, by their confidence
    score_cuts: Cuts  # the same by the score of the nearest detection
    outcome: Ints  # [A] values of `Outcome`, in the order of ``cuts``
    final_error: Floats  # [A] m, minFDE of forecasts of targets, else inf
    fixed_error: float  # m, at the fixed operating point, summed
    counts: StreamCounts
    invalid: Ints  # [3] rows rejected: tracks, hypotheses, objects
    dropped: int  # detections that did not fit into the observation
    skipped: dict[
        str, int
    ]  # rows of the scene that could not be read, by reason; holes in time and their targets
    seconds: float  # per frame, mean without the first frame, in which agents start, unless it is the only one

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def centred(self) -> Floats:
        """The error ``capped`` [n] with the present place of every forecast moved to the truth, m."""
        return capped_error(self.centred_ade, self.miss_error)

    @property
    def own_frag(self) -> Bools:
        """Lost or reacquired [n]."""
        return self.own_lost | self.own_reacquired

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

    Raises RolloutError for a rollout of another scene, or of another number of frames or classes.
    """
    check_rollout(scene, rollout, card)
    scene = evaluated(scene)
    truth, targets, live = (
        separated_truth(scene, card),
        find_targets(scene, card),
        live_frames(scene, card),
    )
    forecasts = RecordedForecasts.of(rollout)
    found = Candidates.of(scene, targets, forecasts, live, card)
    matching = match_by_confidence(found, forecasts.confidence)
    errors, object_of_truth = found.final_errors(matching)
    miss_error = np.asarray(card.per_class(card.task.miss_error))
    of_targets = miss_error[targets.class_id]
    by_confidence = cuts(found, matching, forecasts.confidence, of_targets)
    score = nearest_score(scene, forecasts)
    lineage = hypotheses(rollout, card)
    events = lineage_events(
        truth, rollout, lineage, match_hypotheses(truth, rollout, lineage.member, card)
    )
    of_best = events.of(lineage.best[truth.frame_of_rows])
    unit = units(scene, card)
    outcome, final_error = _outcomes(found, matching, object_of_truth, errors)
    return SceneScore(
        scene=scene.name,
        recording=scene.recording or scene.name,
        frames=scene.frames,
        live=int(live.sum()),
        hypotheses=int(
            np.isfinite(rollout.hypothesis_log_weight).sum(axis=1).max(initial=0)
        ),
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
        miss_error=of_targets,
        **vars(errors),
        capped=capped_error(errors.min_ade, of_targets),
        absent_cause=absent_causes(scene, targets, card),
        own_ids=of_best.ids[targets.row, 0],
        own_lost=of_best.lost[targets.row, 0],
        own_reacquired=of_best.reacquired[targets.row, 0],
        all_h_ids=in_all(truth, lineage, events, "ids")[targets.row],
        all_h_frag=in_all(truth, lineage, events, "frag")[targets.row],
        own_events={kind: int(getattr(of_best, kind).sum()) for kind in KINDS},
        guessed_parents=lineage.guessed,
        cuts=by_confidence,
        score_cuts=cuts(found, match_by_confidence(found, score), score, of_targets),
        outcome=outcome,
        final_error=final_error,
        fixed_error=fixed_error(
            by_confidence,
            rollout.malformed * live[:, None],
            miss_error,
            scene.truth_complete,
        ),
        counts=stream_counts(
            truth, separated_tracks(rollout, scene, card), lineage, card
        ),
        invalid=np.asarray(rollout.invalid).sum(axis=0),
        dropped=int(np.asarray(rollout.dropped).sum()),
        skipped=scene.skipped | left_out(scene, card),
        seconds=float(
            rollout.seconds[1:].mean()
            if len(rollout.seconds) > 1
            else rollout.seconds.sum()
        ),
    )


def mean_plain_error(scores: Sequence[SceneScore]) -> float | None:
    """Mean plain error over the targets of some scenes, m; None without a target."""
    targets = sum(len(score) for score in scores)
    return (
        sum(float(score.capped.sum()) for score in scores) / targets
        if targets
        else None
    )


def nearest_score(scene: Scene, forecasts: RecordedForecasts) -> Floats:
    """Score [S] of the nearest detection of the same frame and class as each forecast, mapped to (-1, 1); else -1.

    In its place it shows what the agent's own confidence is worth (docs/definitions, "Controls, and the gap closed").
    """
    from scipy.spatial import KDTree

    seen = scene.detections
    if not len(seen.box) or not len(forecasts.frame):
        return np.full(len(forecasts.frame), -1.0)
    apart = 1e7  # m between two frames or classes
    tree = KDTree(_places(seen.box, seen.frame_of_rows, seen.class_id, apart))
    distance, nearest = tree.query(
        _places(forecasts.box, forecasts.frame, forecasts.class_id, apart)
    )
    score = seen.score[nearest]
    return np.where(distance < apart / 2, score / (1.0 + np.abs(score)), -1.0)


def _places(box: Floats, frame: Ints, class_id: Ints, apart: float) -> Floats:
    return np.column_stack([box[:, :2], apart * frame, apart * class_id])


def _outcomes(
    found: Candidates,
    matching: IncrementalMatching,
    object_of_truth: Matched,
    errors: ForecastErrors,
) -> tuple[Ints, Floats]:
    """Outcome and minFDE of the forecasts in live frames [A], in the order in which they were added."""
    outcome = np.where(matching.false, Outcome.FALSE_POSITIVE, Outcome.NEUTRAL)
    final_error = np.full(len(outcome), np.inf)
    outcome[object_of_truth[object_of_truth >= 0]] = Outcome.NON_TARGET
    column = object_of_truth[found.targets.row]
    outcome[column[column >= 0]] = Outcome.TARGET
    final_error[column[column >= 0]] = errors.min_fde[column >= 0]
    return outcome[matching.order], final_error[matching.order]


def check_rollout(scene: Scene, rollout: Rollout, card: Card) -> None:
    """Raise RolloutError for a rollout of another scene or card, and for values that no env records.

    A file of rollouts may have been edited.
    """
    where, classes = f"rollout of scene {rollout.scene!r}", len(card.task.classes)
    for what, got, wanted in (
        ("name of the scene", rollout.scene, scene.name),
        ("number of frames", rollout.frames, scene.frames),
        ("number of future frames", rollout.forecast.shape[2], card.task.future),
        ("number of classes", rollout.malformed.shape[1] - 1, classes),
    ):
        if got != wanted:
            raise RolloutError(
                f"{where}: the {what} is {got!r}, expected {wanted!r}; was it run on another card?"
            )
    parents = rollout.hypothesis_parent.shape[1]
    for name, least, most, expected in (
        ("track_box", -_MOST, _MOST, "finite numbers"),
        (
            "track_class",
            -1,
            classes - 1,
            f"-1 to {classes - 1}",
        ),  # -1: not stated, fits every class
        ("hypothesis_parent", -1, parents - 1, f"-1 to {parents - 1}"),
        ("object_box", -_MOST, _MOST, "finite numbers"),
        ("object_class", 0, classes - 1, f"0 to {classes - 1}"),
        ("object_confidence", 0, 1, "values in [0, 1]"),
        ("invalid", 0, _MOST, "0 or more"),
        ("malformed", 0, _MOST, "0 or more"),
        ("dropped", 0, _MOST, "0 or more"),
        ("seconds", 0, _MOST, "a finite time of 0 s or more"),
    ):
        array = np.asarray(getattr(rollout, name))
        bad = ~((array >= least) & (array <= most))  # NaN is bad
        if bad.any():
            row = int(np.argwhere(bad)[0][0])
            table = {"track": rollout.tracks, "object": rollout.objects}.get(
                name.split("_")[0]
            )
            frame = row if table is None else table.frame_of_rows[row]
            raise RolloutError(
                f"{where}: {name} contains {array[bad][0]} (frame {frame}); expected {expected}"
            )
