"""WILDTRACK: the published annotations and MVDet's detections, read into scenes."""

from ..base import SourcePackage
from .source import DATASET, Wildtrack
from .status import wildtrack_status

PACKAGE = SourcePackage(open=Wildtrack, about=lambda card: DATASET, describe=wildtrack_status)
