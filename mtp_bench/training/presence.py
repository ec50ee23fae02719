"""Fit of presence: the probability that a track's object is really there, from tracks of training scenes.

A logistic regression on all scenes, calibrated by isotonic regression on probabilities of models without the scene.
"""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from ..core import Bools, Floats, MtpBenchError, select
from ..prediction import FEATURES, PresenceModel, logistic
from ..running import DEFAULTS, RunOptions
from ..scoring import calibration
from .presence_rows import (
    BLOCK_SECONDS,
    FEW_SCENES,
    MOST_ROWS,
    PresenceRecipe,
    PresenceRows,
    split_rows,
    training_rows,
)
from .split import Split

RIDGE = 0.1  # inverse weight of the squares of all coefficients
FOLDS = 5  # of scenes
DIGITS = 6  # of stored numbers: the same on every machine
KNOT_BINS = 100  # of held-out rows, of equal size, for the isotonic regression
OWN = PresenceRecipe(
    (), ("mean_score", "log_hits", "coasting"), products=False, calibrated=False
)  # logs are short


def fit(rows: PresenceRows, recipe: PresenceRecipe) -> tuple[PresenceModel, Floats]:
    """The model fitted to n rows, and cross-validated probabilities [n] of the rows.

    The model of a held-out row was fitted on other scenes, and calibrated on held-out rows of yet other scenes.
    """
    model = fit_logistic(rows, recipe)
    held_out = np.zeros(len(rows.present))
    parts = folds(rows)
    for away in parts:
        held_out[away] = probabilities(
            fit_logistic(select(rows, ~away), recipe), select(rows, away)
        )
    if not recipe.calibrated:
        return model, held_out
    calibrated = np.zeros(len(held_out))
    for away in parts:
        calibrated[away] = np.interp(
            held_out[away], *isotonic_knots(held_out[~away], rows.present[~away])
        )
    return replace(model, knots=isotonic_knots(held_out, rows.present)), calibrated


def fit_logistic(rows: PresenceRows, recipe: PresenceRecipe) -> PresenceModel:
    """The model before calibration, with its numbers as they are stored."""
    estimator, model = logistic_regression(rows, recipe)
    f = len(model.features)
    names = sorted(set(rows.class_name))
    shared, own = np.split(estimator.coef_[0], [-len(names) * (1 + f)])
    own = _rounded(own).reshape(len(names), 1 + f)
    shared = _rounded(np.concatenate([estimator.intercept_, shared]))
    return replace(model, shared=shared, classes=dict(zip(names, own, strict=True)))


def logistic_regression(
    rows: PresenceRows, recipe: PresenceRecipe
) -> tuple[Any, PresenceModel]:
    """scikit-learn's estimator on `design`, and a model with its standardisation and no coefficients yet."""
    from sklearn.linear_model import LogisticRegression

    if rows.present.std() == 0:
        raise MtpBenchError(
            "of the tracks to fit to, all or none are of true objects, expected both kinds; held-out blocks may hold "
            "the others; --presence scores needs no fit"
        )
    raw = np.stack([FEATURES[name](rows) for name in recipe.features], axis=1)
    low, high = _rounded(np.quantile(raw, [0.001, 0.999], axis=0))
    clipped = np.clip(raw, low, high)
    scale = clipped.std(axis=0)
    model = PresenceModel(
        features=recipe.features,
        low=low,
        high=high,
        center=_rounded(clipped.mean(axis=0)),
        scale=_rounded(np.where(scale > 0, scale, 1.0)),
        shared=np.zeros(1),
        classes={},
        knots=np.array([[0.0, 1.0], [0.0, 1.0]]),
    )
    estimator = LogisticRegression(
        C=RIDGE, solver="newton-cholesky", tol=1e-9, max_iter=200
    )
    return estimator.fit(
        design(model.standardised(rows), rows.class_name, recipe.products), rows.present
    ), model


def design(z: Floats, class_name: Any, products: bool) -> Floats:
    """Columns of the linear model: z [n, F], with ``products`` those of two z, and (1, z) of each class."""
    parts = [z]
    if products:
        first, second = np.triu_indices(z.shape[1])
        parts.append(z[:, first] * z[:, second])
    for name in sorted(set(class_name)):
        parts.append(
            (class_name == name)[:, None]
            * np.concatenate([np.ones((len(z), 1)), z], axis=1)
        )
    return np.concatenate(parts, axis=1)


def folds(rows: PresenceRows) -> list[Bools]:
    """Masks [n] of the rows of each fold: whole scenes in random order, the same in every run."""
    names, place = np.unique(rows.scene, return_inverse=True)
    count = min(FOLDS, len(names))
    if count < 2:
        raise MtpBenchError(
            f"got 1 scene of at most {BLOCK_SECONDS:g} s, expected several, or a longer one: the quality of presence "
            "is that on rows that are held out"
        )
    fold = np.random.default_rng(0).permutation(len(names)) % count
    return [fold[place] == number for number in range(count)]


def isotonic_knots(probability: Floats, present: Bools) -> Floats:
    """Calibration [2, knots]: isotonic regression, with straight lines between the centres of its steps.

    Steps alone would make ties of different probabilities (centred isotonic regression: Oron, Flournoy 2017). The ends
    are 0 and 1; steps at these values are left out, since they would be flat too.
    """
    from sklearn.isotonic import IsotonicRegression

    order = np.argsort(probability, kind="stable")
    bins = [
        part for part in np.array_split(order, min(KNOT_BINS, len(order))) if len(part)
    ]
    x, y = (
        np.array([values[part].mean() for part in bins])
        for values in (probability, present)
    )
    weight = np.array([len(part) for part in bins])
    level = IsotonicRegression(y_min=0, y_max=1).fit_transform(
        x, y, sample_weight=weight
    )
    value, step = np.unique(level, return_inverse=True)
    center = np.bincount(step, x * weight) / np.bincount(step, weight)
    inside = (value > 0) & (value < 1) & (center > 0) & (center < 1)
    knots = _rounded(np.stack([center[inside], value[inside]]))
    return np.concatenate([[[0.0], [0.0]], knots, [[1.0], [1.0]]], axis=1)


def quality(probability: Floats, present: Bools) -> dict[str, Any]:
    """Brier score, AUC and reliability of probabilities [n].

    Reliability is of ten equal bins of the probability: mean, share that is present, rows.
    """
    from sklearn.metrics import roc_auc_score

    brier, curve = calibration(probability, present)
    table = [
        [round(bin.confidence, 3), round(bin.matched, 3), bin.forecasts]
        for bin in curve
    ]
    auc = float(roc_auc_score(present, probability)) if 0 < present.mean() < 1 else 0.5
    return {
        "rows": len(present),
        "brier": round(brier, 4),
        "auc": round(auc, 4),
        "reliability": table,
    }


def score_probability(rows: PresenceRows) -> Floats:
    """The mean score as a probability: scores outside of [0, 1] count as logits."""
    score = rows.mean_score
    return score if score.min() >= 0 and score.max() <= 1 else logistic(score)


def fit_detector(detector: str, options: RunOptions = DEFAULTS) -> str:
    """The presence file of a detector with a recipe, as `mtp_bench.prediction.LearnedPresence` reads it."""
    recipe = PresenceRecipe.of(detector)
    return _fitted(detector, recipe, *training_rows(recipe, options))[0]


def fit_split(split: Split) -> tuple[str, dict[str, Any]]:
    """Return the presence file of the detections of a split, and its quality on rows outside of the fit.

    Rows are held out by scene; of fewer than `FEW_SCENES` scenes by blocks of `BLOCK_SECONDS`. The file has the model
    of all rows. Raises MtpBenchError if there is nothing to fit or to hold out.
    """
    rows, origin = split_rows(split, in_blocks=len(split.names) < FEW_SCENES)
    return _fitted(split.card.detector_name, OWN, rows, [origin])


def _fitted(
    detector: str,
    recipe: PresenceRecipe,
    rows: PresenceRows,
    origin: list[dict[str, Any]],
) -> tuple[str, dict[str, Any]]:
    """The text of a presence file, and the qualities of the score and of the held-out probabilities."""
    n = len(rows.present)
    rows = select(rows, np.arange(0, n, -(-n // MOST_ROWS)))
    model, held_out = fit(rows, recipe)
    qualities = {
        "score": quality(score_probability(rows), rows.present),
        "presence": quality(held_out, rows.present),
    }
    return model_text(detector, recipe, model, origin, qualities), qualities


def model_text(
    detector: str,
    recipe: PresenceRecipe,
    model: PresenceModel,
    origin: list[dict[str, Any]],
    held_out: dict[str, Any],
) -> str:
    """The text of a model's file."""
    content: dict[str, Any] = {"detector": detector}
    if recipe.terms:
        content["terms"] = recipe.terms
    content |= {"fitted_on": origin, "features": list(model.features)}
    content |= {
        key: getattr(model, key).tolist()
        for key in ("low", "high", "center", "scale", "shared")
    }
    content["classes"] = {name: row.tolist() for name, row in model.classes.items()}
    content |= {"knots": model.knots.tolist(), "held_out": held_out}
    rows = [
        f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}"
        for key, value in content.items()
    ]
    return "{\n" + ",\n".join(rows) + "\n}\n"


def probabilities(model: PresenceModel, rows: PresenceRows) -> Floats:
    """Probabilities [n] of rows."""
    names, class_id = np.unique(rows.class_name, return_inverse=True)
    return model.probability(rows, class_id, names.tolist())


def _rounded(values: Floats) -> Floats:
    return np.array([float(f"{value:.{DIGITS}g}") for value in values.ravel()]).reshape(
        values.shape
    )
