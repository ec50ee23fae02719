"""Trackers and association, for agents; the judge never imports them."""

from .birds_eye import BirdsEye as BirdsEye
from .detection_cuts import stored_cuts as stored_cuts
from .given import GivenTracker as GivenTracker
from .joint import k_best as k_best
from .online import OnlineDetections as OnlineDetections
from .online import OnlineTracker as OnlineTracker
from .parameters import AB3DMOT as AB3DMOT
from .parameters import ClassParameters as ClassParameters
from .parameters import ab3dmot_parameters as ab3dmot_parameters
from .parameters import sort_parameters as sort_parameters
from .retracking import ReTracker as ReTracker
from .tracker import HypothesisTracker as HypothesisTracker
from .truth import TruthTracker as TruthTracker
