"""Argoverse 2 sensor dataset: the official Feather files and maps, read into scenes."""

from ..base import SourcePackage
from .files import DATASET, LOGS, Argoverse2Source as Argoverse2Source
from .forecasts import FORMS
from .source import Argoverse2, scene_lanes
from .submission import FORM

PACKAGE = SourcePackage(
    open=Argoverse2,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, LOGS),
    tracks=FORM,
    forecasts=FORMS,
    lanes=scene_lanes,
)
