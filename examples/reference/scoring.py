"""Errors of forecasts, and a test of the difference of two agents over units."""

import numpy as np

from mtp_bench import scoring

speed = np.array([1.0, 2.0, 5.0])[
    :, None, None
]  # of three objects, m per frame in x and in y
truth = np.cumsum(speed * np.ones((3, 12, 2)), axis=1)
samples = (
    truth[:, None] * np.array([0.8, 1.1])[:, None, None]
)  # two samples each, too slow and too fast
print("minADE", scoring.displacement(samples, truth).min_ade.round(2))
of_a, of_b = (
    [1.3, 1.5, 1.1, 1.4, 1.6, 1.2, 1.3],
    [1.6, 1.6, 1.5, 1.6, 1.5, 1.5, 1.5],
)  # errors of agents, per unit
test = scoring.paired_difference(of_a, of_b, np.ones(7))
print(
    f"{test.mean:.2f} m, p = {test.p:.3f}, 95 % {test.interval[0]:.2f} to {test.interval[1]:.2f} m"
)
