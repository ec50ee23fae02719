"""Gymnasium environments of highway-env, one scene per seed."""

from ..highway.source import package
from .source import DATASET, GymScenes, GymSource as GymSource

PACKAGE = package(GymScenes, DATASET)
