"""Trackers and association, for agents; the judge never imports them."""

from .given import GivenTracker as GivenTracker
from .given import TruthTracker as TruthTracker
from .joint import k_best as k_best
from .online import BirdsEye as BirdsEye
from .online import OnlineDetections as OnlineDetections
from .online import OnlineTracker as OnlineTracker
from .parameters import ClassParameters as ClassParameters
from .parameters import detector_parameters as detector_parameters
from .parameters import score_thresholds as score_thresholds
from .tracker import HypothesisTracker as HypothesisTracker
