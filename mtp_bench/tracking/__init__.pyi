from .given import GivenTracker as GivenTracker, TruthTracker as TruthTracker
from .joint import k_best as k_best
from .kernels.compile import kernel as kernel, part as part
from .online import (
    BirdsEye as BirdsEye,
    OnlineDetections as OnlineDetections,
    OnlineTracker as OnlineTracker,
)
from .parameters import (
    ClassParameters as ClassParameters,
    detector_names as detector_names,
    detector_parameters as detector_parameters,
    family_of as family_of,
    read_detector as read_detector,
    score_thresholds as score_thresholds,
)
from .tracker import HypothesisTracker as HypothesisTracker
