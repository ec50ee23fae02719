"""Argoverse 2 sensor dataset: the official Feather files and maps, read into scenes."""

from ..base import SourcePackage
from .layout import DATASET, LOGS, Argoverse2Source as Argoverse2Source
from .road import scene_lanes
from .source import Argoverse2
from .submission import FORM

PACKAGE = SourcePackage(
    Argoverse2,
    DATASET,
    lambda card, data: DATASET.status(data, LOGS),
    FORM,
    lanes=scene_lanes,
)
