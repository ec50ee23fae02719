"""Agents: their interface, and the usual one, made of a tracker, a predictor and a sampler."""

from ..tracks import Objects as Objects, Tracks as Tracks
from ..types import Action as Action, Observation as Observation
from .pipeline import Pipeline as Pipeline
from .protocols import (
    Agent as Agent,
    Forecasts as Forecasts,
    Frame as Frame,
    FunctionPredictor as FunctionPredictor,
    Predictor as Predictor,
    Presence as Presence,
    Sampler as Sampler,
    Tracker as Tracker,
)
