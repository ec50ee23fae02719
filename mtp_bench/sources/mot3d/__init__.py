"""3DMOT2015: people on the ground plane, one sequence read into scenes."""

from ..base import SourcePackage
from .source import DATASET, Mot3d, Mot3dSource as Mot3dSource, folder_of

PACKAGE = SourcePackage(
    open=Mot3d,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, folder_of(card)),
)
