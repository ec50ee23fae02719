"""Version and constants of the definitions that every result carries."""

from __future__ import annotations

import math

DEFINITIONS = "1.0"  # raised whenever a number of an unchanged rollout would change
GOLDEN = "1ecc84035e149abce0cf3236c831a5386b11ceb82c4deec1bb9a1f4440001a93"  # tests/scoring/test_golden_results.py

MISS_RATE_GATE = 2.0  # m, a sample whose final point is farther away misses (MR, EPA)
MOVING_SPEED = 0.5  # m/s, straight displacement over the future by its time; slower targets are "static"
PLANNING_SIGMA = 3.0  # m, PI-ADE weighs a target by exp(-approach^2 / (2 sigma^2))
MOST_FORECASTS = 1.5  # times those of STP: where false ones cost nothing, agents with more are not ranked
FALSE_FORECAST_SHARE = 0.5  # of the miss error c, per false forecast
EPA_ALPHA = 0.5  # penalty of a false forecast in EPA
FORECAST_AP_GATES = (2.0, 4.0)  # m, now and at the final point, of AP_f
MAX_SPEED = 30.0  # m/s, how far a track of the same id may move in a frame when lineages are inferred
CURVE_KS = (1, 5, 10, 20, 50, 100, 200, 400)
DISTANCE_BINS = (0.0, 5.0, 10.0, 15.0, 30.0, 50.0, math.inf)  # m to the ego
CAMERA_HEIGHT = 1.65  # m above the ground on which an object is put to be seen in the image
LEAST_IMAGE_HEIGHT = 25.0  # pixels; labels confirm nothing that is seen this small
MOST_IN_REGION = 0.5  # share in one region where labels do not care; nothing of which more lies there is confirmed
BLOCK_SECONDS = 20.0  # units of uncertainty are blocks of recordings, at most this long
RANKED_OBJECTS = 20  # a subset with fewer objects is shown, never ranked
