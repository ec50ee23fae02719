"""Predictors and samplers, for agents; the judge never imports them."""

from .greedy import GreedySampler as GreedySampler
from .k_means import KMeansSampler as KMeansSampler
from .kalman import NoiseTable as NoiseTable, stored_noise as stored_noise
from .kinematic import (
    HedgedPredictor as HedgedPredictor,
    KinematicPredictor as KinematicPredictor,
)
from .lanes import LanePredictor as LanePredictor
from .learned.local import (
    local_future as local_future,
    local_inputs as local_inputs,
    to_absolute as to_absolute,
)
from .learned.predictor import LearnedPredictor as LearnedPredictor
from .presence import LearnedPresence as LearnedPresence
from .windows import TrackWindows as TrackWindows, windows_of as windows_of
