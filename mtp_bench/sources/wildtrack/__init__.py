"""WILDTRACK: the published annotations and MVDet's detections, read into scenes."""

from ..base import SourcePackage
from .source import ANNOTATIONS, DATASET, Wildtrack, WildtrackSource as WildtrackSource

PACKAGE = SourcePackage(
    open=Wildtrack,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, ANNOTATIONS),
)
