"""3DMOT2015: people on the ground plane, one sequence read into scenes."""

from ..base import SourcePackage
from .source import Mot3d
from .status import about_mot3d, mot3d_status

PACKAGE = SourcePackage(open=Mot3d, about=about_mot3d, describe=mot3d_status)
