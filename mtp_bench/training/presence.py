"""The fit of presence: whether the object of a track is really there, from tracks of training scenes.

A logistic regression, fitted on all scenes; its calibration is an isotonic regression on what models that were fitted
without a scene say of it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import MtpBenchError
from ..prediction.presence import FEATURES, PresenceModel, logistic
from ..running.options import DEFAULTS, RunOptions
from ..types import Bools, Floats, Scene, select
from .presence_rows import PresenceRecipe, Rows, thinned, training_rows

RIDGE = 0.1  # inverse weight of the squares of all coefficients
FOLDS = 5  # of scenes
DIGITS = 6  # of stored numbers: the same on every machine
SCORE_RANKS = 16  # numbers of boxes at which the scores of two detectors are compared
KNOT_BINS = 100  # of held-out rows, of equal size, that the isotonic regression sees


def fit(rows: Rows, recipe: PresenceRecipe) -> tuple[PresenceModel, Floats]:
    """The model of these rows, and what is said of each of them [n] without its scene.

    That is, by a model fitted on other scenes, calibrated by what such models said of yet other scenes.
    """
    model = fit_logistic(rows, recipe)
    said = np.zeros(len(rows.present))
    parts = folds(rows)
    for away in parts:
        said[away] = said_by(fit_logistic(select(rows, ~away), recipe), select(rows, away))
    if not recipe.calibrated:
        return model, said
    checked = np.zeros(len(said))
    for away in parts:
        checked[away] = np.interp(said[away], *isotonic_knots(said[~away], rows.present[~away]))
    return replace(model, knots=isotonic_knots(said, rows.present)), checked


def fit_logistic(rows: Rows, recipe: PresenceRecipe) -> PresenceModel:
    """The model before calibration, its numbers as they are stored."""
    estimator, model = logistic_regression(rows, recipe)
    f, names = len(model.features), sorted(set(rows.class_name))
    shared, own = np.split(estimator.coef_[0], [-len(names) * (1 + f)])
    own = _rounded(own).reshape(len(names), 1 + f)
    shared = _rounded(np.concatenate([estimator.intercept_, shared]))
    return replace(model, shared=shared, classes=dict(zip(names, own, strict=True)))


def logistic_regression(rows: Rows, recipe: PresenceRecipe) -> tuple[Any, PresenceModel]:
    """scikit-learn's estimator on `design`, and a model that standardises as it and has no coefficients yet."""
    from sklearn.linear_model import LogisticRegression

    raw = np.stack([FEATURES[name](rows) for name in recipe.features], axis=1)
    low, high = _rounded(np.quantile(raw, [0.001, 0.999], axis=0))
    clipped = np.clip(raw, low, high)
    scale = clipped.std(axis=0)
    model = PresenceModel(
        recipe.features,
        low,
        high,
        _rounded(clipped.mean(axis=0)),
        _rounded(np.where(scale > 0, scale, 1.0)),
        np.zeros(1),
        {},
        np.array([[0.0, 1.0], [0.0, 1.0]]),
    )
    estimator = LogisticRegression(C=RIDGE, solver="newton-cholesky", tol=1e-9, max_iter=200)
    return estimator.fit(design(model.standardised(rows), rows.class_name, recipe.products), rows.present), model


def design(z: Floats, class_name: Any, products: bool) -> Floats:
    """What the logit is linear in: z [n, F], its products of two where asked for, and (1, z) of each class."""
    parts = [z]
    if products:
        first, second = np.triu_indices(z.shape[1])
        parts.append(z[:, first] * z[:, second])
    for name in sorted(set(class_name)):
        parts.append((class_name == name)[:, None] * np.concatenate([np.ones((len(z), 1)), z], axis=1))
    return np.concatenate(parts, axis=1)


def folds(rows: Rows) -> list[Bools]:
    """The rows [n] of each fold: whole scenes, by lot, the same in every run."""
    names, place = np.unique(rows.scene, return_inverse=True)
    count = min(FOLDS, len(names))
    if count < 2:
        raise MtpBenchError("presence is calibrated and judged on held-out scenes, and there is only one scene")
    fold = np.random.default_rng(0).permutation(len(names)) % count
    return [fold[place] == number for number in range(count)]


def isotonic_knots(probability: Floats, present: Bools) -> Floats:
    """Calibration [2, knots]: isotonic regression, with straight lines between the centres of its steps.

    Steps alone would make ties of what the model tells apart (centred isotonic regression: Oron, Flournoy 2017). The
    ends are 0 and 1; steps at these values are left out, for they would be flat too.
    """
    from sklearn.isotonic import IsotonicRegression

    order = np.argsort(probability, kind="stable")
    bins = [part for part in np.array_split(order, min(KNOT_BINS, len(order))) if len(part)]
    x, y = (np.array([values[part].mean() for part in bins]) for values in (probability, present))
    weight = np.array([len(part) for part in bins])
    level = IsotonicRegression(y_min=0, y_max=1).fit_transform(x, y, sample_weight=weight)
    value, step = np.unique(level, return_inverse=True)
    center = np.bincount(step, x * weight) / np.bincount(step, weight)
    inside = (value > 0) & (value < 1) & (center > 0) & (center < 1)
    knots = np.stack([center[inside], value[inside]])
    return np.concatenate([[[0.0], [0.0]], _rounded(knots), [[1.0], [1.0]]], axis=1)


def quality(probability: Floats, present: Bools) -> dict[str, Any]:
    """How good probabilities [n] are.

    Reliability is of ten equal bins of the probability: mean, share that is there, rows.
    """
    from sklearn.metrics import roc_auc_score

    place = np.minimum((probability * 10).astype(int), 9)
    table = [
        [round(float(probability[mine].mean()), 3), round(float(present[mine].mean()), 3), int(mine.sum())]
        for mine in (place == b for b in range(10))
        if mine.any()
    ]
    brier = float(np.mean((probability - present) ** 2))
    auc = float(roc_auc_score(present, probability)) if 0 < present.mean() < 1 else 0.5
    return {"rows": len(present), "brier": round(brier, 4), "auc": round(auc, 4), "reliability": table}


def raw_score(rows: Rows) -> Floats:
    """The mean score as a probability: as it is where scores lie in [0, 1], else as a logit."""
    score = rows.mean_score
    return score if score.min() >= 0 and score.max() <= 1 else logistic(score)


def fit_detector(detector: str, options: RunOptions = DEFAULTS) -> str:
    """The presence file of a detector with a recipe, as `mtp_bench.prediction.LearnedPresence` reads it."""
    recipe = PresenceRecipe.of(detector)
    if recipe.like is not None:
        return fit_scores(detector, recipe, options)
    rows, origin = training_rows(recipe, options)
    rows = thinned(rows)
    model, said = fit(rows, recipe)
    held_out = {"score": quality(raw_score(rows), rows.present), "presence": quality(said, rows.present)}
    return as_json(detector, recipe, model, origin, held_out)


def fit_scores(detector: str, recipe: PresenceRecipe, options: RunOptions = DEFAULTS) -> str:
    """The file of a detector whose scores stand for those of another one; the truth is not read."""
    here, there = (choice.open(options) for choice in recipe.choices(detector))
    classes = here.card.task.classes
    scores = [_scores(list(split.scenes()), len(classes)) for split in (here, there)]
    table = {name: score_table(mine, other).tolist() for name, mine, other in zip(classes, *scores, strict=True)}
    content = {"detector": detector, "terms": recipe.terms, "like": recipe.like}
    return lines_of({**content, "score_map": {name: rows for name, rows in table.items() if len(rows[0]) > 2}})


def score_table(here: Floats, there: Floats) -> Floats:
    """Scores [2, n] of equal rank, counted from the top, of two detectors on the same scenes; the ends are 0 and 1.

    Ranks count boxes, not shares: the detector that keeps more weak boxes is not taken to be better for it.
    """
    least = min(len(here), len(there))
    rank = np.unique(np.geomspace(1, max(least, 1), SCORE_RANKS).astype(int))[:least][::-1]
    pairs = np.stack([np.sort(scores)[::-1][rank - 1] for scores in (here, there)])
    inside = (pairs > 0).all(axis=0) & (pairs < 1).all(axis=0)
    fresh = np.append(True, np.diff(pairs[0][inside]) > 0) if inside.any() else np.zeros(0, dtype=bool)
    knots = _rounded(pairs[:, inside][:, fresh])
    return np.concatenate([[[0.0], [0.0]], knots, [[1.0], [1.0]]], axis=1)


def _scores(scenes: Sequence[Scene], classes: int) -> list[Floats]:
    """Scores of all detections of each class."""
    class_id, score = (
        np.concatenate([getattr(scene.detections, key) for scene in scenes]) for key in ("class_id", "score")
    )
    return [score[class_id == number] for number in range(classes)]


def as_json(
    detector: str, recipe: PresenceRecipe, model: PresenceModel, origin: list[dict[str, Any]], held_out: dict[str, Any]
) -> str:
    """The text of a model's file."""
    content: dict[str, Any] = {"detector": detector}
    if recipe.terms:
        content["terms"] = recipe.terms
    content |= {"fitted_on": origin, "features": list(model.features)}
    content |= {key: getattr(model, key).tolist() for key in ("low", "high", "center", "scale", "shared")}
    content["classes"] = {name: row.tolist() for name, row in model.classes.items()}
    content |= {"knots": model.knots.tolist(), "held_out": held_out}
    return lines_of(content)


def lines_of(content: dict[str, Any]) -> str:
    """JSON with a line per key."""
    rows = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in content.items()]
    return "{\n" + ",\n".join(rows) + "\n}\n"


def said_by(model: PresenceModel, rows: Rows) -> Floats:
    """Probabilities [n] of rows."""
    names, class_id = np.unique(rows.class_name, return_inverse=True)
    return model.probability(rows, class_id, names.tolist())


def _rounded(values: Floats) -> Floats:
    """To DIGITS significant digits."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values.ravel()]).reshape(values.shape)
