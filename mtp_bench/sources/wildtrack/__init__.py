"""WILDTRACK: the published annotations and MVDet's detections, read into scenes."""

from ..base import SourcePackage
from .source import Wildtrack
from .status import wildtrack_status

PACKAGE = SourcePackage(open=Wildtrack, describe=wildtrack_status)
