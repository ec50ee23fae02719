"""Gymnasium environments of highway-env, of the library or one's own, one scene per seed."""

from ..highway.source import package
from .source import DATASET, GymScenes, GymSource as GymSource

PACKAGE = package(GymScenes, DATASET)
