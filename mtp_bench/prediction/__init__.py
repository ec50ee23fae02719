"""Predictors and samplers, for agents; the judge never imports them."""

from .hedged import HedgedPredictor as HedgedPredictor
from .hedged import StandingStill as StandingStill
from .imm import ImmPredictor as ImmPredictor
from .imm_noise import ImmNoise as ImmNoise
from .imm_noise import stored_imm_noise as stored_imm_noise
from .k_means import KMeansSampler as KMeansSampler
from .kalman import NoiseTable as NoiseTable
from .kinematic import KinematicPredictor as KinematicPredictor
from .motion_noise import stored_noise as stored_noise
from .presence import LearnedPresence as LearnedPresence
