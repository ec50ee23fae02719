"""The probability that a track's object is really there, learned on training splits and evaluated in plain NumPy.

A logistic regression over what the tracker remembers of a track, with coefficients per class, and a calibration that
puts its probabilities right; one small file per detector in ``presence_models/``, made by ``mtp-bench train presence``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import final

import numpy as np

from ..errors import SubmissionError, nearest
from ..tracking.parameters import family_of
from ..tracks import Tracks
from ..types import Floats, Ints, Observation, Task
from .presence_file import LikeFile, read_file

MODELS = Path(__file__).with_name("presence_models")
# Per class, scores [2, n] of a detector and those of another one that finds as many boxes above them, both increasing.
ScoreTables = Mapping[str, Floats]
DEFAULT = "default"  # of a detector without a file of its own: hits, misses and age


@dataclass(frozen=True, eq=False)
class History:
    """What is known of N tracks, from which features are made."""

    last_score: Floats  # [N] of the last detection
    mean_score: Floats  # [N] of all detections
    hits: Ints  # [N] detections
    age: Ints  # [N] frames since the first detection, this one included
    unseen: Ints  # [N] frames since the last detection
    range: Floats  # [N] m to the ego
    speed: Floats  # [N] m/s over the past that is kept


FEATURES: dict[str, Callable[[History], Floats]] = {
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


def history_of(tracks: Tracks, observation: Observation, dt: float) -> History:
    """The history of N tracks after a frame; where a tracker does not state hits and age, those of the past it keeps.

    ``observation``: of that frame (only ``ego_pose`` is read, and may be missing); ``dt``: s, nominal frame period.
    """
    n, valid = len(tracks.box), tracks.past_valid
    last = valid.shape[1] - 1
    first = np.where(valid.any(axis=1), valid.argmax(axis=1), last)
    lived = last - first  # frames
    hits = np.maximum(valid.sum(axis=1), 1) if tracks.hits is None else tracks.hits
    age = lived + 1 if tracks.age is None else tracks.age
    longer = np.clip(age - hits, 0, valid.shape[1])  # not seen in all the past that is kept
    unseen = np.where(valid.any(axis=1), valid[:, ::-1].argmax(axis=1), longer)
    moved = tracks.past[:, -1, :2] - tracks.past[np.arange(n), first, :2]
    ego = np.asarray(observation.get("ego_pose", np.zeros(2)), dtype=np.float64)
    return History(
        last_score=tracks.score if tracks.last_score is None else tracks.last_score,
        mean_score=tracks.score,
        hits=hits,
        age=np.maximum(age, hits),
        unseen=unseen,
        range=np.linalg.norm(tracks.box[:, :2] - ego[:2], axis=1),
        speed=np.linalg.norm(moved, axis=1) / (np.maximum(lived, 1) * dt),
    )


@dataclass(frozen=True, eq=False)
class PresenceModel:
    """A logistic model of presence and its calibration.

    The F features are clipped to the range of the training data and standardised to z. The logit is ``shared`` times
    (1, z, products of two z with i <= j in the order of `numpy.triu_indices`), the products only where there are that
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

    def standardised(self, history: History) -> Floats:
        """Features z [N, F] of N tracks."""
        raw = np.stack([FEATURES[name](history) for name in self.features], axis=1)
        return np.asarray((np.clip(raw, self.low, self.high) - self.center) / self.scale)

    def logits(self, z: Floats, class_id: Ints, classes: Sequence[str]) -> Floats:
        """Logits [N] before calibration; ``class_id`` [N] counts in ``classes``."""
        f = len(self.features)
        own = np.array([self.classes.get(name, np.zeros(1 + f)) for name in classes])[class_id]
        logit = self.shared[0] + z @ self.shared[1 : 1 + f] + own[:, 0] + (own[:, 1:] * z).sum(axis=1)
        if len(self.shared) > 1 + f:
            product = np.zeros((f, f))
            product[np.triu_indices(f)] = self.shared[1 + f :]
            logit += (z @ product * z).sum(axis=1)
        return np.asarray(logit)

    def probability(self, history: History, class_id: Ints, classes: Sequence[str]) -> Floats:
        """Calibrated probabilities [N] of N tracks."""
        said = logistic(self.logits(self.standardised(history), class_id, classes))
        return np.asarray(np.interp(said, *self.knots))


def mapped(score: Floats, tables: ScoreTables, class_id: Ints, classes: Sequence[str]) -> Floats:
    """Scores [N] in place of those of this detector; those of a class without a table stay as they are."""
    result = np.array(score, dtype=np.float64)
    for number, name in enumerate(classes):
        if name in tables:
            mine = class_id == number
            result[mine] = np.interp(result[mine], *tables[name])
    return result


def logistic(logit: Floats) -> Floats:
    """1 / (1 + exp(-logit)), without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * logit)))


@final
class LearnedPresence:
    """The presence of tracks of the task's detector.

    ``model``: file that ``mtp-bench train presence`` wrote. By default the one that ships for the detector, by the part
    of its name before the first hyphen; a detector without one takes ``default.json``, which knows hits, misses and age
    alone.

    Raises SubmissionError at ``reset`` where there is no such file or it holds something else.
    """

    def __init__(self, model: str | Path | None = None) -> None:
        self._file = None if model is None else Path(model)

    def reset(self, task: Task) -> None:
        """A new scene begins."""
        self._task = task
        self._model, self._scores = read_model(self._file or file_of(task.detector))

    def probability(self, tracks: Tracks, observation: Observation) -> Floats:
        """Probability [N] that each track's object is there."""
        class_id, classes = tracks.class_id, self._task.classes
        history = history_of(tracks, observation, self._task.dt)
        scores = history.last_score, history.mean_score
        last, mean = (mapped(score, self._scores, class_id, classes) for score in scores)
        return self._model.probability(replace(history, last_score=last, mean_score=mean), class_id, classes)


def file_of(detector: str) -> Path:
    """The file that ships for a detector, or the default's."""
    own = MODELS / f"{family_of(detector)}.json"
    return own if own.is_file() else MODELS / f"{DEFAULT}.json"


def fitted_on(detector: str) -> tuple[str, ...]:
    """Names of the scenes that the presence of a detector was fitted on: it is no news to it what is there.

    Where one of them is scored, the manifest of an agent says so (``[trained_on_scored]``), and tables too.
    """
    content = read_file(file_of(detector))
    if isinstance(content, LikeFile):
        return fitted_on(content.like)
    return tuple(name for part in content.fitted_on for name in part.scenes)


def read_model(path: Path) -> tuple[PresenceModel, ScoreTables]:
    """The model of a file, and by which tables scores are mapped before it.

    Raises SubmissionError, naming the file and what is wrong, where it is no such file.
    """
    return _model_of(path.resolve(), path.stat().st_mtime_ns if path.is_file() else 0)


@cache
def _model_of(path: Path, changed: int) -> tuple[PresenceModel, ScoreTables]:
    """What the file holds that was changed last at this time, ns: it may be trained again meanwhile."""
    content = read_file(path)
    if isinstance(content, LikeFile):
        _require_known(path, "detector in like", content.like, [file.stem for file in MODELS.glob("*.json")])
        other = file_of(content.like)
        if isinstance(read_file(other), LikeFile):
            raise SubmissionError(
                f"{path}: like is {content.like!r}, which itself is like another detector; expected one that has a "
                "model of its own"
            )
        return read_model(other)[0], {name: np.array(rows) for name, rows in content.score_map.items()}
    for name in content.features:
        _require_known(path, "feature", name, FEATURES)
    return PresenceModel(
        features=tuple(content.features),
        **{key: np.array(getattr(content, key)) for key in ("low", "high", "center", "scale", "shared", "knots")},
        classes={name: np.array(row) for name, row in content.classes.items()},
    ), {}


def _require_known(path: Path, kind: str, got: str, known: Iterable[str]) -> None:
    if got not in (names := tuple(known)):
        raise SubmissionError(f"{path}: unknown {kind} {got!r}{nearest(got, names)}")
