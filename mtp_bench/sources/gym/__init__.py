"""Gymnasium environments of highway-env, of the library or one's own, one scene per seed."""

from ..base import SourcePackage
from .source import DATASET, GymScenes, generate, gym_status
from .source import GymSource as GymSource

PACKAGE = SourcePackage(
    open=GymScenes,
    dataset=DATASET,
    locate=gym_status,
    prepare=generate,
    discard=lambda card: GymScenes(card).discard(),
)
