"""Trackers and association, for agents; the judge never imports them."""

from .given import GivenTracker as GivenTracker, TruthTracker as TruthTracker
from .joint import k_best as k_best
from .online import (
    BirdsEye as BirdsEye,
    OnlineDetections as OnlineDetections,
    OnlineTracker as OnlineTracker,
)
from .parameters import (
    ClassParameters as ClassParameters,
    detector_parameters as detector_parameters,
    score_thresholds as score_thresholds,
)
from .tracker import HypothesisTracker as HypothesisTracker
