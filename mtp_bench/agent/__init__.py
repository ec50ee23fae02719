"""Agents: their interface, and the usual one, made of a tracker, a predictor and a sampler."""

from ..tracks import Objects as Objects
from ..tracks import Tracks as Tracks
from ..types import Action as Action
from ..types import Observation as Observation
from .pipeline import Pipeline as Pipeline
from .protocols import Agent as Agent
from .protocols import Forecasts as Forecasts
from .protocols import Frame as Frame
from .protocols import FunctionPredictor as FunctionPredictor
from .protocols import Predictor as Predictor
from .protocols import Presence as Presence
from .protocols import Sampler as Sampler
from .protocols import Tracker as Tracker
