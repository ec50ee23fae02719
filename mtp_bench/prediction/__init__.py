"""Predictors and samplers, for agents; the judge never imports them."""

from .greedy import GreedySampler as GreedySampler
from .k_means import KMeansSampler as KMeansSampler
from .kalman import NoiseTable as NoiseTable
from .kalman import stored_noise as stored_noise
from .kinematic import HedgedPredictor as HedgedPredictor
from .kinematic import KinematicPredictor as KinematicPredictor
from .lanes import LanePredictor as LanePredictor
from .learned.local import local_future as local_future
from .learned.local import local_inputs as local_inputs
from .learned.local import to_absolute as to_absolute
from .learned.predictor import LearnedPredictor as LearnedPredictor
from .presence import LearnedPresence as LearnedPresence
from .windows import TrackWindows as TrackWindows
from .windows import windows_of as windows_of
