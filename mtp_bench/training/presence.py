"""Fit of presence: the probability that a track's object is really there.

It learns from tracks of training scenes: a logistic regression on all scenes,
calibrated by isotonic regression on probabilities of models without the scene.
"""

import json
from typing import Any

import numpy as np

from ..core import Bools, Floats, MtpBenchError, select
from ..prediction import PRESENCE_FEATURES, Origin, PresenceModel, logistic
from ..running import DEFAULTS, RunOptions
from ..scoring import calibration
from .presence_rows import (
    BLOCK_SECONDS,
    FEW_SCENES,
    MOST_ROWS,
    PresenceRecipe,
    PresenceRows,
    recipe_of,
    split_rows,
    training_rows,
)
from .split import Split

RIDGE = 0.1  # inverse weight of the squares of all coefficients
FOLDS = 5  # of scenes
DIGITS = 6  # of stored numbers: the same on every machine
KNOT_BINS = 100  # of held-out rows, of equal size, for the isotonic regression
_CLIPPED_RANKS = (0.001, 0.999)  # of features: values outside are clipped
# for detections of one's own, whose logs are short
OWN_RECIPE = PresenceRecipe(
    (), ("mean_score", "log_hits", "coasting"), products=False, calibrated=False
)


def fit(rows: PresenceRows, recipe: PresenceRecipe) -> tuple[PresenceModel, Floats]:
    """Fit a model to n rows, with cross-validated probabilities [n].

    The model of a held-out row was fitted on other scenes, and calibrated on held-out
    rows of yet other scenes.
    """
    model = fit_logistic(rows, recipe)
    held_out = np.zeros(len(rows.present))
    row_folds = folds(rows)
    for fold in row_folds:
        fold_model = fit_logistic(select(rows, ~fold), recipe)
        held_out[fold] = probabilities(fold_model, select(rows, fold))
    if not recipe.calibrated:
        return model, held_out
    calibrated = np.zeros(len(held_out))
    for fold in row_folds:
        fold_knots = isotonic_knots(held_out[~fold], rows.present[~fold])
        calibrated[fold] = np.interp(held_out[fold], *fold_knots)
    knots = isotonic_knots(held_out, rows.present).tolist()
    return model.model_copy(update={"knots": knots}), calibrated


def fit_logistic(rows: PresenceRows, recipe: PresenceRecipe) -> PresenceModel:
    """Fit the model before calibration, with numbers rounded as stored."""
    estimator, model = logistic_regression(rows, recipe)
    class_names = sorted(set(rows.class_name))
    per_class = 1 + len(model.features)
    # the columns of `design`: blocks of the classes come last
    shared, by_class = np.split(estimator.coef_[0], [-len(class_names) * per_class])
    class_rows = _rounded(by_class).reshape(len(class_names), per_class)
    shared = _rounded(np.concatenate([estimator.intercept_, shared]))
    classes = dict(zip(class_names, class_rows.tolist(), strict=True))
    return model.model_copy(update={"shared": shared.tolist(), "classes": classes})


def logistic_regression(
    rows: PresenceRows, recipe: PresenceRecipe
) -> tuple[Any, PresenceModel]:
    """Fit scikit-learn's estimator to `design`.

    Returns it with a model of its inputs' standardisation. The caller fills in the
    coefficients and the knots of the calibration.
    """
    from sklearn.linear_model import LogisticRegression

    if rows.present.std() == 0:
        raise MtpBenchError(
            "of the tracks to fit to, all or none are of true objects, expected both "
            "kinds; held-out blocks may hold the others; --presence scores needs no fit"
        )
    raw = np.stack(
        [PRESENCE_FEATURES[feature_name](rows) for feature_name in recipe.features],
        axis=1,
    )
    low, high = _rounded(np.quantile(raw, _CLIPPED_RANKS, axis=0))
    clipped = np.clip(raw, low, high)
    scale = clipped.std(axis=0)
    model = PresenceModel(
        features=list(recipe.features),
        low=low.tolist(),
        high=high.tolist(),
        center=_rounded(clipped.mean(axis=0)).tolist(),
        scale=_rounded(np.where(scale > 0, scale, 1.0)).tolist(),
        shared=[0.0] * (1 + len(scale)),
        classes={},
        knots=[[0.0, 1.0], [0.0, 1.0]],  # no calibration yet
    )
    columns = design(model.standardised(rows), rows.class_name, recipe.products)
    estimator = LogisticRegression(
        C=RIDGE, solver="newton-cholesky", tol=1e-9, max_iter=200
    )
    return estimator.fit(columns, rows.present), model


def design(z: Floats, class_name: Any, products: bool) -> Floats:
    """Return the columns of the linear model.

    They are the standardised features ``z`` [n, F], with ``products`` the products of
    two of them, and for each class 1 and ``z`` in its rows, 0 in others.
    """
    blocks = [z]
    if products:
        first, second = np.triu_indices(z.shape[1])
        blocks.append(z[:, first] * z[:, second])
    with_one = np.concatenate([np.ones((len(z), 1)), z], axis=1)
    for name_of_class in sorted(set(class_name)):
        blocks.append((class_name == name_of_class)[:, None] * with_one)
    return np.concatenate(blocks, axis=1)


def folds(rows: PresenceRows) -> list[Bools]:
    """Return masks [n] of the rows of each fold.

    A fold is of whole scenes in random order, the same in every run.
    """
    scene_names, scene = np.unique(rows.scene, return_inverse=True)
    count = min(FOLDS, len(scene_names))
    if count < 2:
        raise MtpBenchError(
            f"got 1 scene of at most {BLOCK_SECONDS:g} s, expected several, or a "
            "longer one: the quality of presence is that on rows that are held out"
        )
    fold_of_scene = np.random.default_rng(0).permutation(len(scene_names)) % count
    return [fold_of_scene[scene] == number for number in range(count)]


def isotonic_knots(probability: Floats, present: Bools) -> Floats:
    """Return a calibration [2, knots] by isotonic regression.

    Straight lines join the centres of its steps: steps alone would make ties of
    different probabilities (centred isotonic regression: Oron, Flournoy 2017). The ends
    are 0 and 1; steps at these values are left out, since they would be flat too.
    """
    from sklearn.isotonic import IsotonicRegression

    order = np.argsort(probability, kind="stable")
    bins = np.array_split(order, min(KNOT_BINS, len(order)))
    x = np.array([probability[rows].mean() for rows in bins])
    y = np.array([present[rows].mean() for rows in bins])
    weight = np.array([len(rows) for rows in bins])
    regression = IsotonicRegression(y_min=0, y_max=1)
    level = regression.fit_transform(x, y, sample_weight=weight)
    value, step = np.unique(level, return_inverse=True)
    center = np.bincount(step, x * weight) / np.bincount(step, weight)
    is_inside = (value > 0) & (value < 1) & (center > 0) & (center < 1)
    knots = _rounded(np.stack([center[is_inside], value[is_inside]]))
    return np.concatenate([[[0.0], [0.0]], knots, [[1.0], [1.0]]], axis=1)


def quality(probability: Floats, present: Bools) -> dict[str, Any]:
    """Return Brier score, AUC and reliability of probabilities [n].

    Reliability has a row for each of ten equal bins of the probability: its mean, the
    share of tracks that is present, and the number of tracks.
    """
    from sklearn.metrics import roc_auc_score

    brier, curve = calibration(probability, present)
    table = [
        [round(row.confidence, 3), round(row.matched, 3), row.forecasts]
        for row in curve
    ]
    auc = 0.5
    if 0 < present.mean() < 1:
        auc = float(roc_auc_score(present, probability))
    return {
        "rows": len(present),
        "brier": round(brier, 4),
        "auc": round(auc, 4),
        "reliability": table,
    }


def score_probability(rows: PresenceRows) -> Floats:
    """Return the mean scores of tracks as probabilities [n].

    If any is outside of [0, 1], all count as logits.
    """
    score = rows.mean_score
    if score.min() >= 0 and score.max() <= 1:
        return score
    return logistic(score)


def fit_detector(detector: str, options: RunOptions = DEFAULTS) -> str:
    """Return the text of the presence file of a detector with a recipe.

    `mtp_bench.prediction.LearnedPresence` reads it.
    """
    recipe = recipe_of(detector)
    rows, origins = training_rows(recipe, options)
    text, _ = _fitted(detector, recipe, rows, origins)
    return text


def fit_split(split: Split) -> tuple[str, dict[str, Any]]:
    """Return the text of the presence file of a split, and its quality.

    The quality is that on held-out rows. Rows are held out by scene; of fewer than
    `FEW_SCENES` scenes by blocks of `BLOCK_SECONDS`. The file has the model of all
    rows. Raises MtpBenchError if there is nothing to fit or to hold out.
    """
    rows, origin = split_rows(split, in_blocks=len(split.names) < FEW_SCENES)
    return _fitted(split.card.detector_name, OWN_RECIPE, rows, [origin])


def _fitted(
    detector: str,
    recipe: PresenceRecipe,
    rows: PresenceRows,
    origins: list[Origin],
) -> tuple[str, dict[str, Any]]:
    """Return the text of a presence file, and the qualities in it.

    They are those of the score and of the held-out probabilities.
    """
    # every n-th row, at most `MOST_ROWS`
    count = len(rows.present)
    rows = select(rows, np.arange(0, count, -(-count // MOST_ROWS)))
    model, held_out = fit(rows, recipe)
    qualities = {
        "score": quality(score_probability(rows), rows.present),
        "presence": quality(held_out, rows.present),
    }
    return model_text(detector, recipe, model, origins, qualities), qualities


def model_text(
    detector: str,
    recipe: PresenceRecipe,
    model: PresenceModel,
    origins: list[Origin],
    held_out: dict[str, Any],
) -> str:
    """Return the text of a model's file."""
    facts = {"detector": detector, "fitted_on": origins, "held_out": held_out}
    complete = model.model_copy(update={**facts, "terms": recipe.terms})
    content = complete.model_dump(exclude={"score_map"})
    if not recipe.terms:  # a file has the key only with terms
        del content["terms"]
    lines = [
        f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}"
        for key, value in content.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def probabilities(model: PresenceModel, rows: PresenceRows) -> Floats:
    """Return probabilities [n] of rows."""
    class_names, class_id = np.unique(rows.class_name, return_inverse=True)
    return model.probability(rows, class_id, class_names.tolist())


def _rounded(values: Floats) -> Floats:
    """Round to `DIGITS` significant digits."""
    digits = [float(f"{value:.{DIGITS}g}") for value in values.ravel()]
    return np.array(digits).reshape(values.shape)
