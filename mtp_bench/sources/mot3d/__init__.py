"""3DMOT2015: people on the ground plane, one sequence read into scenes."""

from ..base import SourcePackage
from .source import DATASET, Mot3d, folder_of
from .source import Mot3dSource as Mot3dSource

PACKAGE = SourcePackage(open=Mot3d, dataset=DATASET, locate=lambda card, data: DATASET.status(data, folder_of(card)))
