"""Is a simulated detector like the real one? A classifier looks at histories of objects.

    python benchmarks/detector_realism.py [--markdown page.md]

The stored and the simulated detections of the same true objects are matched to them. A history is what one object
looked like in `HISTORY` frames: found or missed, errors of place, heading and size, and scores. Both have the same
objects, classes and ranges. A classifier (gradient boosting) learns which is which on some scenes and says it in the
others. Its AUC is .5 where nothing tells them apart, and 1 where everything does. It also looks at one part of a history
at a time, which says what it uses.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from mtp_bench.cards import load_card, with_detector, with_split
from mtp_bench.core import Scene, wrap_angle
from mtp_bench.core.geometry import rotate
from mtp_bench.sources import covered_truth, detection_matches, open_source

HISTORY = 6  # frames
PAIRS = (  # env, its stored detector if it is another one, and the profile
    ("MTP-KITTI-v0", None, "kitti_pointrcnn_raw"),
    ("MTP-KITTI-v0", None, "kitti_pointrcnn"),
    ("MTP-nuScenes-mini-v0", None, "nuscenes_megvii_raw"),
    ("MTP-nuScenes-mini-v0", None, "nuscenes_megvii"),
    ("MTP-nuScenes-mini-v0", "centerpoint", "nuscenes_centerpoint"),
)
PARTS = {
    "found, place, score": [0, 1, 2, 7],
    "found": [0],
    "place": [1, 2],
    "heading": [3],
    "size": [4, 5, 6],
    "score": [7],
}
FOLDS = 5


class Histories(NamedTuple):
    """Histories [n, HISTORY, 8] of objects, NaN where they are missed, and class and range [n, 2]."""

    values: np.ndarray
    context: np.ndarray


def histories(scene: Scene, env: str, least_score: float) -> Histories:
    card = load_card(env)
    detections = scene.detections
    kept = detections.score >= least_score
    scene = scene if kept.all() else _with(scene, kept)
    detections = scene.detections
    truth = scene.truth
    true_row = detection_matches(scene, card)
    found = np.flatnonzero(true_row >= 0)
    seen = np.full((len(truth.box), 8), np.nan)
    seen[:, 0] = 0
    box, true_box = detections.box[found], truth.box[true_row[found]]
    offset = rotate(box[:, :2] - true_box[:, :2], -true_box[:, 3])
    turn = wrap_angle(box[:, 3] - true_box[:, 3])
    ratio = np.log(box[:, 4:] / true_box[:, 4:])
    seen[true_row[found]] = np.column_stack(
        [np.ones(len(found)), offset, turn, ratio, detections.score[found]]
    )
    rows = np.flatnonzero(covered_truth(scene, card, true_row))
    frame = truth.frame_of_rows
    rows = rows[np.lexsort([frame[rows], truth.object_id[rows]])]
    values, context = [], []
    for start in range(0, len(rows) - HISTORY + 1, 2):
        window = rows[start : start + HISTORY]
        is_one = truth.object_id[window[0]] == truth.object_id[window[-1]]
        if is_one and frame[window[-1]] - frame[window[0]] == HISTORY - 1:
            last = window[-1]
            range_m = np.linalg.norm(truth.box[last, :2] - scene.ego[frame[last], :2])
            values.append(seen[window])
            context.append([truth.class_id[last], range_m])
    return Histories(
        np.array(values).reshape(-1, HISTORY, 8), np.array(context).reshape(-1, 2)
    )


def _with(scene: Scene, kept: np.ndarray) -> Scene:
    return replace(scene, detections=scene.detections.select(kept))


def measured(
    env: str, detector: str | None, profile: str
) -> Iterator[tuple[str, int, float]]:
    """Yield part, histories and AUC."""
    card = load_card(env)
    if detector is not None:  # stored for the validation scenes alone
        card = with_split(card, "mini_val")
    real_card = card if detector is None else with_detector(card, detector)
    real, made = open_source(real_card), open_source(with_detector(card, profile))
    floor = min(
        made.load(name).detections.score.min(initial=np.inf) for name in made.names
    )
    values, context, label, group = [], [], [], []
    for number, name in enumerate(real.names):
        for kind, source in enumerate((real, made)):
            part = histories(source.load(name), env, floor)
            values.append(part.values)
            context.append(part.context)
            label.append(np.full(len(part.values), kind))
            group.append(np.full(len(part.values), number))
    x, known, y, scene = map(np.concatenate, (values, context, label, group))
    folds = GroupKFold(min(FOLDS, len(real.names)))
    for name, columns in {"all": list(range(8)), **PARTS}.items():
        inputs = np.column_stack([x[:, :, columns].reshape(len(x), -1), known])
        chance = cross_val_predict(
            HistGradientBoostingClassifier(random_state=0),
            inputs,
            y,
            groups=scene,
            cv=folds,
            method="predict_proba",
        )
        yield name, len(x), float(roc_auc_score(y, chance[:, 1]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--markdown", type=Path, help="write the table here, too")
    given = parser.parse_args()
    lines = [
        f"| profile | environment | histories | all | {' | '.join(PARTS)} |",
        "|---|---|--:|" + "--:|" * (1 + len(PARTS)),
    ]
    print(lines[0])
    for env, detector, profile in PAIRS:
        rows = list(measured(env, detector, profile))
        values = [f"{auc:.2f}" for _, _, auc in rows]
        lines.append(f"| `{profile}` | `{env}` | {rows[0][1]} | {' | '.join(values)} |")
        print(lines[-1], flush=True)
    if given.markdown:
        given.markdown.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
