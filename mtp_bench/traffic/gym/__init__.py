"""Gymnasium environments of highway-env, one scene per seed."""

from ..highway.source import package
from .scenes import DATASET, GymScenes
from .source import GymSource as GymSource

PACKAGE = package(GymScenes, DATASET)
