"""Presence and a predictor trained on simulated detections, measured on recorded ones.

    python benchmarks/transfer.py presence [--data ROOT]
    python benchmarks/transfer.py predictor --data TRAINVAL [--split val] [--scenes 100] [--also-scenes 130]

Presence: AUC on the tracks of recorded scenes, of the model that was fitted on simulated detections and of one that was
fitted on other scenes of the same recordings. Predictor: minADE on the tracklets of 20 hypotheses of recorded scenes,
targets with a whole future, weighed by the mass of their hypotheses; one network learnt from recorded scenes, one from
simulated ones, both without velocities where the recorded detector has none. Simulated traffic has no trailers and no
construction vehicles: they are forecast as trucks.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from mtp_bench.core.parallel import Workers
from mtp_bench.prediction.learned.network import network_of
from mtp_bench.prediction.learned.predictor import StoredWeights, read_weights
from mtp_bench.prediction.presence import file_of, read_model
from mtp_bench.prediction.windows import to_absolute
from mtp_bench.running.options import RunOptions
from mtp_bench.training import Windows, windows
from mtp_bench.training.predictors import (
    HYPOTHESES,
    TrainingRequest,
    has_future,
    train_predictor,
    training_windows,
)
from mtp_bench.training.presence import fit, probabilities, quality
from mtp_bench.training.presence_rows import (
    PresenceRecipe,
    PresenceRows,
    recipe_of,
    training_rows,
)

PRESENCE = {
    "megvii": ("nuscenes_megvii_raw", "nuscenes_megvii"),
    "pointrcnn": ("kitti_pointrcnn_raw",),
}
REAL, SIMULATED = "MTP-nuScenes-v0", ("MTP-IntersectionRaw-v0", "MTP-Roundabout-v0")
STANDS_FOR = {"trailer": "truck", "construction_vehicle": "truck"}
ROWS = 20_000  # windows that are forecast at once


def presence(given: argparse.Namespace) -> None:
    """AUC of both models on recorded tracks, over all classes and of each."""
    for detector, profiles in PRESENCE.items():
        recipe = recipe_of(detector)
        rows, _ = training_rows(recipe, RunOptions(given.data))
        same = replace(
            recipe, features=PresenceRecipe(()).features, products=True, calibrated=True
        )
        said = {
            "recorded": fit(rows, recipe)[1],
            "recorded, all features": fit(rows, same)[1],
        }
        for profile in profiles:
            model = read_model(file_of(profile))
            said[profile] = probabilities(model, rows)
        best = max(
            _auc(rows, said[name], None)
            for name in ("recorded", "recorded, all features")
        )
        print(
            f"{detector}: {len(rows.present)} tracks in frames, {100 * rows.present.mean():.0f} % there"
        )
        for name, values in said.items():
            every = _auc(rows, values, None)
            own = ", ".join(
                f"{c} {_auc(rows, values, c):.3f}" for c in sorted(set(rows.class_name))
            )
            print(
                f"  {name:28} AUC {every:.4f} ({100 * every / best:.1f} % of the best fitted here); {own}"
            )


def _auc(rows: PresenceRows, said: np.ndarray, class_name: str | None) -> float:
    mine = (
        np.ones(len(said), dtype=bool)
        if class_name is None
        else rows.class_name == class_name
    )
    return float(quality(said[mine], rows.present[mine])["auc"])


def predictor(given: argparse.Namespace) -> None:
    """Errors of both networks on recorded tracklets."""
    workers = Workers(given.jobs)
    requests = {
        f"{given.scenes} scenes of {REAL}": (
            TrainingRequest(given.network, REAL, "tracklets"),
            given.scenes,
            given.data,
        ),
        f"{given.also_scenes} scenes each of {', '.join(SIMULATED)}": (
            TrainingRequest(
                given.network, SIMULATED[0], "tracklets", also=SIMULATED[1:]
            ),
            given.also_scenes,
            None,
        ),
    }
    asked = windows(
        REAL, given.split, HYPOTHESES, None, RunOptions(given.data, workers=workers)
    )
    asked = asked.select(has_future(asked) & asked.target & asked.future_known.all(1))
    still = _error(
        asked,
        np.zeros((len(asked), 1, asked.future.shape[1], 2))
        + asked.box[:, -1, None, None, :2],
    )
    print(
        f"{REAL}, {given.split}: {len(asked)} windows of tracklets; standing still {still:.3f} m"
    )
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, (request, scenes, data)) in enumerate(requests.items()):
            start = time.process_time()
            found = training_windows(request, RunOptions(data, scenes, workers=workers))
            found = (
                found if asked.surroundings.velocity.any() else without_velocity(found)
            )
            path, card = train_predictor(
                found, request, Path(folder) / f"{number}.safetensors"
            )
            stored = read_weights(path, network_of(request.network))
            error = _error(asked, _forecasts(asked, stored))
            spent = time.process_time() - start
            print(
                f"  {given.network} from {name}: minADE {error:.3f} m; {card['windows']} windows, validation "
                f"{card['validation_minADE']} m, {spent:.0f} CPU-s",
                flush=True,
            )


def without_velocity(found: Windows) -> Windows:
    """The windows as of a detector that measures no velocities."""
    seen = replace(
        found.surroundings, velocity=np.zeros_like(found.surroundings.velocity)
    )
    return replace(found, velocity=np.zeros_like(found.velocity), surroundings=seen)


def _forecasts(asked: Windows, stored: StoredWeights) -> np.ndarray:
    """Samples ``[n, k, T, 2]`` of a network; classes that it does not know stand for others."""
    known = stored.sizes.classes
    own = [
        known.index(name if name in known else STANDS_FOR[name])
        for name in asked.task.classes
    ]
    asked = replace(asked, class_id=np.array(own)[asked.class_id])
    seen = replace(
        asked.surroundings, class_id=np.array(own)[asked.surroundings.class_id]
    )
    network, parts = network_of(stored.network), []
    for low in range(0, len(asked), ROWS):
        part = asked.select(slice(low, low + ROWS))
        said = network.forward(
            stored.weights,
            network.inputs(part, part.moment, seen, stored.sizes),
            stored.sizes,
        )
        parts.append(to_absolute(part, said["modes"]))
    return np.concatenate(parts)


def _error(asked: Windows, samples: np.ndarray) -> float:
    away = np.linalg.norm(samples - asked.future[:, None], axis=-1).mean(-1).min(1)
    return float(np.average(away, weights=asked.mass))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("presence")
    one.set_defaults(run=presence)
    two = commands.add_parser("predictor")
    two.add_argument("--network", default="modes")
    two.add_argument("--split", default="val")
    two.add_argument(
        "--scenes", type=int, default=100, help="recorded ones to learn from"
    )
    two.add_argument(
        "--also-scenes",
        type=int,
        default=130,
        help="simulated ones to learn from, of each env",
    )
    two.add_argument("--jobs", type=int, default=2)
    two.set_defaults(run=predictor)
    for each in (one, two):
        each.add_argument("--data")
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
