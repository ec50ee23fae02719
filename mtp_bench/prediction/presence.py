"""Probability that the object of a track is really there.

It is learned on training splits and evaluated in plain NumPy: a logistic regression
over the history of a track, with coefficients per class, and a calibration of its
probabilities. There is one small file per detector in ``presence_models/``, made by
``mtp-bench maintain presence``; ``mtp-bench train presence`` makes one for detections
of one's own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self, final

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from ..core import (
    SCORES,
    Floats,
    Ints,
    Observation,
    Section,
    SubmissionError,
    Task,
    Tracks,
    nearest,
    read_json,
    validate,
)
from ..tracking import family_of

MODELS = Path(__file__).with_name("presence_models")
_upper = lru_cache(np.triu_indices)


@dataclass(frozen=True, eq=False)
class TrackHistory:
    """History of N tracks, from which features are computed."""

    last_score: Floats  # [N] score of the last detection
    mean_score: Floats  # [N] mean score of all detections
    hits: Ints  # [N] number of detections
    age: Ints  # [N] frames since the first detection, this one included
    unseen: Ints  # [N] frames since the last detection
    range: Floats  # [N] m, distance to the ego
    speed: Floats  # [N] m/s over the past that is kept


PRESENCE_FEATURES: dict[str, Callable[[TrackHistory], Floats]] = {
    "last_score": lambda h: h.last_score,
    "mean_score": lambda h: h.mean_score,
    "log_hits": lambda h: np.log(h.hits),
    "one_by_hits": lambda h: 1 / h.hits,
    "unseen": lambda h: h.unseen.astype(np.float64),
    "coasting": lambda h: (h.unseen > 0).astype(np.float64),
    "miss_share": lambda h: (h.age - h.hits) / h.age,
    "log_misses": lambda h: np.log1p(h.age - h.hits),
    "log_range": lambda h: np.log1p(h.range),
    "log_speed": lambda h: np.log1p(h.speed),
}


def history_of(tracks: Tracks, observation: Observation, dt: float) -> TrackHistory:
    """Return the history of N tracks after a frame.

    Hits and age that a tracker does not state are taken from its pasts.
    ``observation``: of that frame (only ``ego_pose`` is read, and may be missing);
    ``dt``: s, nominal frame period.
    """
    valid = tracks.past_valid
    past_frames = valid.shape[1]
    ever_seen = valid.any(axis=1)
    first_frame = np.where(ever_seen, valid.argmax(axis=1), past_frames - 1)
    lifetime = past_frames - 1 - first_frame  # frames
    hits = tracks.hits
    if hits is None:
        hits = np.maximum(valid.sum(axis=1), 1)
    age = tracks.age
    if age is None:
        age = lifetime + 1
    last_score = tracks.last_score
    if last_score is None:
        last_score = tracks.score
    # for tracks that are not seen in all the past that is kept
    misses = np.clip(age - hits, 0, past_frames)
    first_place = tracks.past[np.arange(len(valid)), first_frame, :2]
    distance_m = np.linalg.norm(tracks.past[:, -1, :2] - first_place, axis=1)
    ego = np.asarray(observation.get("ego_pose", np.zeros(2)), dtype=np.float64)
    return TrackHistory(
        last_score=last_score,
        mean_score=tracks.score,
        hits=hits,
        age=np.maximum(age, hits),
        unseen=np.where(ever_seen, valid[:, ::-1].argmax(axis=1), misses),
        range=np.linalg.norm(tracks.box[:, :2] - ego[:2], axis=1),
        speed=distance_m / (np.maximum(lifetime, 1) * dt),
    )


def _increasing(table_rows: list[list[float]]) -> list[list[float]]:
    """Raise ValueError unless two lists have one length and the first rises."""
    lengths = [len(row) for row in table_rows]
    if len(lengths) != 2 or lengths[0] != lengths[1] or lengths[0] < 2:
        raise ValueError(
            f"lengths {lengths}, expected two lists of one length, at least 2"
        )
    if any(later <= earlier for earlier, later in pairwise(table_rows[0])):
        raise ValueError("expected a first list whose numbers rise")
    return table_rows


# [2, n] input and output, n >= 2
Table = Annotated[list[list[float]], AfterValidator(_increasing)]
_Probability = Annotated[float, Field(ge=0, le=1)]


class Origin(Section):
    """Scenes of a split that were learnt from."""

    env: str
    split: str
    detector: str
    scenes: list[str]


class PresenceModel(Section):
    """Logistic model of presence and its calibration, as a file states it.

    The F features are clipped to the range of the training data and standardised to z.
    The logit is ``shared`` times (1, z, products of two z with i <= j in the order of
    `numpy.triu_indices`), the products only if there are that many numbers, plus
    ``classes[name]`` times (1, z); a class without numbers has the shared ones alone.
    The probability is then mapped by the ``knots``, increasing and linear between them.
    """

    detector: str = ""
    terms: str = ""
    # manifests of agents state those that are scored
    fitted_on: list[Origin] = Field(default_factory=list)
    features: Annotated[list[str], Field(min_length=1)]  # F of PRESENCE_FEATURES
    low: list[float]  # [F]
    high: list[float]  # [F]
    center: list[float]  # [F]
    scale: list[Annotated[float, Field(gt=0)]]  # [F]
    shared: list[float]  # [1 + F] or [1 + F + F (F + 1) / 2]
    classes: dict[str, list[float]]  # [1 + F] each
    # [2, n] probabilities before and after calibration, n >= 2
    knots: Annotated[list[list[_Probability]], AfterValidator(_increasing)]
    # quality on scenes outside its fit
    held_out: dict[str, Any] = Field(default_factory=dict)
    # per class, scores of a detector and those of another one that finds as many boxes
    # above them; scores are mapped by it first
    score_map: dict[str, Table] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _lengths_fit(self) -> Self:
        count = len(self.features)
        with_products = 1 + count + count * (count + 1) // 2
        for name in ("low", "high", "center", "scale"):
            _require_length(name, getattr(self, name), (count,), features=count)
        shared_lengths = (1 + count, with_products)
        _require_length("shared", self.shared, shared_lengths, features=count)
        for name, row in self.classes.items():
            _require_length(f"classes.{name}", row, (1 + count,), features=count)
        return self

    def standardised(self, history: TrackHistory) -> Floats:
        """Return standardised features z [N, F] of N tracks."""
        raw = np.stack(
            [
                PRESENCE_FEATURES[feature_name](history)
                for feature_name in self.features
            ],
            axis=1,
        )
        clipped = np.clip(raw, self.low, self.high)
        return np.asarray((clipped - self.center) / self.scale)

    def logits(self, z: Floats, class_id: Ints, classes: Sequence[str]) -> Floats:
        """Return logits [N] before calibration.

        ``class_id`` [N]: index into ``classes``.
        """
        count = len(self.features)
        no_weights = [0.0] * (1 + count)
        class_weights = np.array([self.classes.get(c, no_weights) for c in classes])
        weights = class_weights[class_id]
        logit = self.shared[0] + z @ self.shared[1 : 1 + count]
        logit = logit + weights[:, 0] + (weights[:, 1:] * z).sum(axis=1)
        if len(self.shared) > 1 + count:
            product = np.zeros((count, count))
            product[_upper(count)] = self.shared[1 + count :]
            logit += (z @ product * z).sum(axis=1)
        return np.asarray(logit)

    def probability(
        self, history: TrackHistory, class_id: Ints, classes: Sequence[str]
    ) -> Floats:
        """Return calibrated probabilities [N] of N tracks."""
        raw = logistic(self.logits(self.standardised(history), class_id, classes))
        raw_levels, calibrated_levels = self.knots
        return np.asarray(np.interp(raw, raw_levels, calibrated_levels))


def _require_length(
    field_name: str,
    field_values: Sequence[float],
    lengths: Sequence[int],
    features: int,
) -> None:
    if len(field_values) not in lengths:
        expected = " or ".join(map(str, lengths))
        raise ValueError(
            f"{field_name} has {len(field_values)} numbers, expected {expected} "
            f"for {features} features"
        )


def map_scores(
    score: Floats, tables: Mapping[str, Table], class_id: Ints, classes: Sequence[str]
) -> Floats:
    """Map scores [N] to those of another detector, by class.

    ``tables``: see `PresenceModel.score_map`; ``class_id`` [N]: index into ``classes``.
    Scores of a class without a table stay as they are.
    """
    mapped = np.array(score, dtype=np.float64)
    for number, class_name in enumerate(classes):
        if class_name in tables:
            class_rows = class_id == number
            scores, mapped_scores = tables[class_name]
            mapped[class_rows] = np.interp(mapped[class_rows], scores, mapped_scores)
    return mapped


def logistic(logit: Floats) -> Floats:
    """Return 1 / (1 + exp(-logit)), without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * logit)))


@final
class LearnedPresence:
    """Presence of the tracks of the task's detector.

    ``model``: file that ``mtp-bench train presence`` wrote. By default that of the task
    (``--presence``), else the one that ships for the detector or the detector it is a
    variant of; a detector without one takes ``default.json``, which uses hits, misses
    and age alone. A task with ``presence="scores"`` takes the score of each track's
    last detection.

    Raises SubmissionError at ``reset`` if there is no such file or it is not a presence
    model, and at a score outside [0, 1] that is to be a probability.
    """

    def __init__(self, model: str | Path | None = None) -> None:
        self._file = None if model is None else Path(model)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        self._by_score = self._file is None and task.presence == SCORES
        if not self._by_score:
            path = self._file or Path(task.presence or file_of(task.detector))
            self._model = read_model(path)

    def probability(self, tracks: Tracks, observation: Observation) -> Floats:
        """Return the probability [N] that each track's object is there."""
        class_id = tracks.class_id
        classes = self._task.classes
        history = history_of(tracks, observation, self._task.dt)
        score = history.last_score
        if self._by_score:
            outside = score[(score < 0) | (score > 1)]
            if len(outside):
                raise SubmissionError(
                    f"a detection has the score {outside[0]:g}, expected [0, 1], as "
                    "presence takes scores as they are; `mtp-bench train presence` "
                    "fits a model to other scores"
                )
            return np.asarray(score, dtype=np.float64)
        tables = self._model.score_map
        mapped_history = replace(
            history,
            last_score=map_scores(score, tables, class_id, classes),
            mean_score=map_scores(history.mean_score, tables, class_id, classes),
        )
        return self._model.probability(mapped_history, class_id, classes)


def file_of(detector: str) -> Path:
    """Return the file that ships for a detector, or the default."""
    path = MODELS / f"{family_of(detector)}.json"
    return path if path.is_file() else MODELS / "default.json"


def read_model(path: Path) -> PresenceModel:
    """Return the model of a file.

    Raises SubmissionError, naming the file and what is wrong, if it is not a presence
    model.
    """
    changed_ns = path.stat().st_mtime_ns if path.is_file() else 0
    return _read_version(path.resolve(), changed_ns)


@lru_cache(maxsize=16)
def _read_version(path: Path, changed_ns: int) -> PresenceModel:
    """Read a model once per modification: it may be trained again.

    ``changed_ns``: time of the modification, a key of the cache.
    """
    content = read_json(path, SubmissionError)
    model = validate(PresenceModel, content, str(path), SubmissionError)
    for name in model.features:
        if name not in PRESENCE_FEATURES:
            hint = nearest(name, tuple(PRESENCE_FEATURES))
            raise SubmissionError(f"{path}: unknown feature {name!r}{hint}")
    return model
