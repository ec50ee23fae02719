"""Version, constants and subsets of the definitions that every result carries."""

import math
from typing import Literal, get_args

DEFINITIONS = "3.1"  # raised whenever a number of an unchanged rollout would change
WEIGHTS_DEFINITIONS = "3.0"  # raised whenever a count of events would change
# tests/scoring/test_golden_results.py
GOLDEN = "195ccd395a2be54c2642206445429a4ea9816aed903c9c7c4abd5b2f7a24a5bf"

MISS_RATE_GATE = 2.0  # m, a sample whose final point is farther away misses (MR, EPA)
# m/s, straight displacement over the future by its time; slower targets are "static"
MOVING_SPEED = 0.5
# rad, change of the true heading over the future; targets above are "turning"
TURNING = 0.5
PLANNING_SIGMA = 3.0  # m, PI-ADE weighs a target by exp(-approach^2 / (2 sigma^2))
# equal steps up to the card's number of false forecasts, at most one per target: their
# mean ranks "all"
BUDGETS = 10
# budgets where false forecasts cannot be known, beside the card's number
FORECASTS_PER_FRAME = (20.0, 40.0)
# false forecasts per target
CURVE_BUDGETS = (
    0.0,
    0.05,
    0.1,
    0.2,
    0.3,
    0.4,
    0.5,
    0.6,
    0.7,
    0.8,
    0.9,
    1.0,
    1.25,
    1.5,
    2.0,
    3.0,
    5.0,
)
FIXED_CONFIDENCE = (
    0.5  # confidence from which the fixed operating point keeps a forecast
)
# cost of a false forecast at the fixed operating point, as a share of the miss error c
FALSE_FORECAST_SHARE = 0.5
# forecasts of a frame without cost at the fixed operating point, where false ones
# cannot be known
FREE_FORECASTS = 40
SAMPLE_FLOOR = 0.01  # of the uniform weight; lighter samples are absent
EPA_ALPHA = 0.5  # penalty of a false forecast in EPA
FORECAST_AP_GATES = (2.0, 4.0)  # m, now and at the final point, of AP_f
# m/s, how far a track of the same id may move in a frame when lineages are inferred
MAX_SPEED = 30.0
CURVE_KS = (1, 5, 10, 20, 50, 100, 200, 400)
DISTANCE_BINS = (0.0, 5.0, 10.0, 15.0, 30.0, 50.0, math.inf)  # m to the ego
RANKED_SUBSETS = ("ids", "reacquired")  # beside "all"; the others are shown
RANKED_OBJECTS = 20  # effective number; a subset with fewer is shown, never ranked
# effective number of units; with fewer no test can tell agents apart
RANKED_UNITS = 6
LARGEST_SHARE = 0.25  # of the weight of an event subset that one unit may have
SIGNIFICANT = 0.05  # p of the sign-flip test
# excess over STP on all targets from which event subsets do not rank, if significant
GUARD_SIGNIFICANT = 0.01
GUARD = 0.05  # the same, whatever p is
# m above the ground on which an object is put to be seen in the image
CAMERA_HEIGHT = 1.65
LEAST_IMAGE_HEIGHT = 25.0  # pixels; labels confirm nothing that is seen this small
# share in one region where labels do not care; nothing of which more lies there is
# confirmed
MOST_IN_REGION = 0.5
BLOCK_SECONDS = 20.0  # units of uncertainty are blocks of recordings, at most this long

# Weights from 0 to 1 over one array of targets (docs/definitions, "Subsets"). Reports
# and records have "turning" only where a target turns, older records never; it is
# shown, not ranked.
Subset = Literal[
    "all", "ids", "lost", "reacquired", "frag", "paper_ids", "paper_frag", "turning"
]
KNOWN_SUBSETS: tuple[Subset, ...] = get_args(Subset)
SUBSETS = KNOWN_SUBSETS[:-1]  # of every report and record
