"""Probability that the object of a track is really there, learned on training splits and evaluated in plain NumPy.

A logistic regression over the history of a track, with coefficients per class, and a calibration of its probabilities;
one small file per detector in ``presence_models/``, made by ``mtp-bench maintain presence``; ``mtp-bench train
presence`` makes one for detections of one's own.
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
# Per class, scores [2, n] of a detector and those of another one that finds as many boxes above them, both increasing.
ScoreTables = Mapping[str, Floats]
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


FEATURES: dict[str, Callable[[TrackHistory], Floats]] = {
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
    """The history of N tracks after a frame; hits and age that a tracker does not state are taken from its pasts.

    ``observation``: observation of that frame. Only its ``ego_pose`` is read, and may
    be missing. ``dt``: s, nominal frame period.
    """
    n = len(tracks.box)
    valid = tracks.past_valid
    last = valid.shape[1] - 1
    seen = valid.any(axis=1)
    first = np.where(seen, valid.argmax(axis=1), last)
    lifetime = last - first  # frames
    hits = np.maximum(valid.sum(axis=1), 1) if tracks.hits is None else tracks.hits
    age = lifetime + 1 if tracks.age is None else tracks.age
    longer = np.minimum(
        np.maximum(age - hits, 0), valid.shape[1]
    )  # not seen in all the past that is kept
    moved = tracks.past[:, -1, :2] - tracks.past[np.arange(n), first, :2]
    ego = np.asarray(observation.get("ego_pose", np.zeros(2)), dtype=np.float64)
    return TrackHistory(
        last_score=tracks.score if tracks.last_score is None else tracks.last_score,
        mean_score=tracks.score,
        hits=hits,
        age=np.maximum(age, hits),
        unseen=np.where(seen, valid[:, ::-1].argmax(axis=1), longer),
        range=np.linalg.norm(tracks.box[:, :2] - ego[:2], axis=1),
        speed=np.linalg.norm(moved, axis=1) / (np.maximum(lifetime, 1) * dt),
    )


@dataclass(frozen=True, eq=False)
class PresenceModel:
    """A logistic model of presence and its calibration.

    The F features are clipped to the range of the training data and standardised to z. The logit is ``shared`` times
    (1, z, products of two z with i <= j in the order of `numpy.triu_indices`), the products only if there are that
    many numbers, plus ``classes[name]`` times (1, z); a class without numbers has the shared ones alone. The
    probability is then mapped by the ``knots``, increasing and linear between them.
    """

    features: tuple[str, ...]  # F of FEATURES
    low: Floats  # [F]
    high: Floats  # [F]
    center: Floats  # [F]
    scale: Floats  # [F]
    shared: Floats  # [1 + F] or [1 + F + F (F + 1) / 2]
    classes: Mapping[str, Floats]  # [1 + F] each
    knots: Floats  # [2, n] probabilities before and after calibration, n >= 2

    def standardised(self, history: TrackHistory) -> Floats:
        """Standardised features z [N, F] of N tracks."""
        raw = np.stack([FEATURES[name](history) for name in self.features], axis=1)
        return np.asarray(
            (np.clip(raw, self.low, self.high) - self.center) / self.scale
        )

    def logits(self, z: Floats, class_id: Ints, classes: Sequence[str]) -> Floats:
        """Logits [N] before calibration; ``class_id`` [N] counts in ``classes``."""
        f = len(self.features)
        own = np.array([self.classes.get(name, np.zeros(1 + f)) for name in classes])[
            class_id
        ]
        logit = (
            self.shared[0]
            + z @ self.shared[1 : 1 + f]
            + own[:, 0]
            + (own[:, 1:] * z).sum(axis=1)
        )
        if len(self.shared) > 1 + f:
            product = np.zeros((f, f))
            product[_upper(f)] = self.shared[1 + f :]
            logit += (z @ product * z).sum(axis=1)
        return np.asarray(logit)

    def probability(
        self, history: TrackHistory, class_id: Ints, classes: Sequence[str]
    ) -> Floats:
        """Calibrated probabilities [N] of N tracks."""
        raw = logistic(self.logits(self.standardised(history), class_id, classes))
        return np.asarray(np.interp(raw, *self.knots))


def map_scores(
    score: Floats, tables: ScoreTables, class_id: Ints, classes: Sequence[str]
) -> Floats:
    """Scores [N] of another detector in place of these; those of a class without a table stay as they are."""
    mapped = np.array(score, dtype=np.float64)
    for number, name in enumerate(classes):
        if name in tables:
            own = class_id == number
            mapped[own] = np.interp(mapped[own], *tables[name])
    return mapped


def logistic(logit: Floats) -> Floats:
    """1 / (1 + exp(-logit)), without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * logit)))


@final
class LearnedPresence:
    """Presence of the tracks of the task's detector.

    ``model``: file that ``mtp-bench train presence`` wrote. By default that of the task (``--presence``), else the one
    that ships for the detector or the detector it is a variant of; a detector without one takes ``default.json``, which
    uses hits, misses and age alone. A task with ``presence="scores"`` takes the score of each track's last detection.

    Raises SubmissionError at ``reset`` if there is no such file or it is not a presence model, and at a score outside
    [0, 1] that is to be a probability.
    """

    def __init__(self, model: str | Path | None = None) -> None:
        self._file = None if model is None else Path(model)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        self._by_score = self._file is None and task.presence == SCORES
        if not self._by_score:
            self._model, self._scores = read_model(
                self._file or Path(task.presence or file_of(task.detector))
            )

    def probability(self, tracks: Tracks, observation: Observation) -> Floats:
        """Probability [N] that each track's object is there."""
        class_id = tracks.class_id
        classes = self._task.classes
        history = history_of(tracks, observation, self._task.dt)
        if self._by_score:
            outside = history.last_score[
                (history.last_score < 0) | (history.last_score > 1)
            ]
            if len(outside):
                raise SubmissionError(
                    f"a detection has the score {outside[0]:g}, expected [0, 1], as presence takes scores as they are; "
                    "`mtp-bench train presence` fits a model to other scores"
                )
            return np.asarray(history.last_score, dtype=np.float64)
        last = map_scores(history.last_score, self._scores, class_id, classes)
        mean = map_scores(history.mean_score, self._scores, class_id, classes)
        return self._model.probability(
            replace(history, last_score=last, mean_score=mean), class_id, classes
        )


def _increasing(rows: list[list[float]]) -> list[list[float]]:
    if len(rows) != 2 or len(rows[0]) != len(rows[1]) or len(rows[0]) < 2:
        raise ValueError(
            f"lengths {[len(row) for row in rows]}, expected two lists of one length, at least 2"
        )
    if any(later <= earlier for earlier, later in pairwise(rows[0])):
        raise ValueError("expected a first list whose numbers rise")
    return rows


Table = Annotated[
    list[list[float]], AfterValidator(_increasing)
]  # [2, n] input and output, n >= 2
_Probability = Annotated[float, Field(ge=0, le=1)]


class Origin(Section):
    """Scenes of a split that were learnt from."""

    env: str
    split: str
    detector: str
    scenes: list[str]


class ModelFile(Section):
    """Numbers of a `mtp_bench.prediction.presence.PresenceModel`."""

    detector: str = ""
    terms: str = ""
    fitted_on: list[Origin] = Field(
        default_factory=list
    )  # manifests of agents state those that are scored
    features: Annotated[list[str], Field(min_length=1)]  # F
    low: list[float]  # [F]
    high: list[float]  # [F]
    center: list[float]  # [F]
    scale: list[Annotated[float, Field(gt=0)]]  # [F]
    shared: list[float]  # [1 + F] or [1 + F + F (F + 1) / 2]
    classes: dict[str, list[float]]  # [1 + F] each
    knots: Annotated[list[list[_Probability]], AfterValidator(_increasing)]
    held_out: dict[str, Any] = Field(
        default_factory=dict
    )  # quality on scenes outside its fit
    score_map: dict[str, Table] = Field(
        default_factory=dict
    )  # per class; scores are mapped by it first

    @model_validator(mode="after")
    def _lengths_fit(self) -> Self:
        f = len(self.features)
        rows = {
            name: (getattr(self, name), [f])
            for name in ("low", "high", "center", "scale")
        }
        rows["shared"] = (self.shared, [1 + f, 1 + f + f * (f + 1) // 2])
        rows |= {
            f"classes.{name}": (row, [1 + f]) for name, row in self.classes.items()
        }
        for name, (row, lengths) in rows.items():
            if len(row) not in lengths:
                expected = " or ".join(map(str, lengths))
                raise ValueError(
                    f"{name} has {len(row)} numbers, expected {expected} for {f} features"
                )
        return self


def read_file(path: Path) -> ModelFile:
    """The content of a file; raises SubmissionError, naming the file and the key, if it is not a presence model."""
    return validate(
        ModelFile, read_json(path, SubmissionError), str(path), SubmissionError
    )


def file_of(detector: str) -> Path:
    """The file that ships for a detector, or the default one."""
    own = MODELS / f"{family_of(detector)}.json"
    return own if own.is_file() else MODELS / "default.json"


def read_model(path: Path) -> tuple[PresenceModel, ScoreTables]:
    """The model of a file, and the tables by which scores are mapped before it.

    Raises SubmissionError, naming the file and what is wrong, if it is not a presence model.
    """
    return _read_state(path.resolve(), path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=16)
def _read_state(path: Path, changed: int) -> tuple[PresenceModel, ScoreTables]:
    """The model of a file that was ``changed`` last at this time, ns: it may be trained again meanwhile."""
    content = read_file(path)
    for name in content.features:
        if name not in FEATURES:
            raise SubmissionError(
                f"{path}: unknown feature {name!r}{nearest(name, tuple(FEATURES))}"
            )
    arrays = {
        key: np.array(getattr(content, key))
        for key in ("low", "high", "center", "scale", "shared", "knots")
    }
    classes = {name: np.array(row) for name, row in content.classes.items()}
    tables = {name: np.array(rows) for name, rows in content.score_map.items()}
    return PresenceModel(
        features=tuple(content.features), classes=classes, **arrays
    ), tables
