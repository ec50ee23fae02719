"""A predictor without training, scored: every object goes on, and turns on as it did.

    python examples/own_predictor.py

Simulated traffic: no data is downloaded.
"""

# --8<-- [start:predictor]
import numpy as np

import mtp_bench
from mtp_bench.prediction import KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def constant_turn(tracks, task):
    """Ten futures of each track [N, 10, T, 2], metres: five speeds, with no turn and with half of the measured one."""
    place = (
        tracks.past[..., 0] + 1j * tracks.past[..., 1]
    )  # [N, P] as complex numbers, oldest first
    known = tracks.past_valid[:, 1:] & tracks.past_valid[:, :-1]
    step = np.where(known, np.diff(place), 0)  # [N, P - 1] metres per frame
    turn = np.angle(
        (step[:, 1:] * step[:, :-1].conj()).sum(axis=1)
    )  # [N] radians per frame
    velocity = step.sum(axis=1) / np.maximum(
        known.sum(axis=1), 1
    )  # [N] metres per frame
    speed, share = (
        np.repeat(np.linspace(0.2, 1.3, 5), 2),
        np.tile([0.0, 0.5], 5),
    )  # of each sample
    heading = np.exp(
        1j * np.multiply.outer(np.outer(turn, share), np.arange(1, task.future + 1))
    )  # [N, 10, T]
    path = place[:, -1, None, None] + np.cumsum(
        np.outer(velocity, speed)[..., None] * heading, axis=2
    )
    return np.stack([path.real, path.imag], axis=-1)


# --8<-- [end:predictor]
# --8<-- [start:evaluate]
def own(task):
    """Build the agent: a tracker, the predictor, and a sampler that keeps k of all samples of an object."""
    predictor = mtp_bench.FunctionPredictor(constant_turn)
    return mtp_bench.Pipeline(
        HypothesisTracker(1), predictor, KMeansSampler(), presence=LearnedPresence()
    )


print(mtp_bench.evaluate(own, "MTP-Intersection-v0", scenes=3))
# --8<-- [end:evaluate]
# --8<-- [start:compare]
print(mtp_bench.compare([own], "MTP-Intersection-v0", scenes=3))
# --8<-- [end:compare]
