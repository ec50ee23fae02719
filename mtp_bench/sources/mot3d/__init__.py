"""3DMOT2015: people on the ground plane, one sequence read into scenes."""

from ..base import SourcePackage
from .layout import DATASET, folder_of, inspect
from .layout import Mot3dSource as Mot3dSource
from .source import Mot3d

PACKAGE = SourcePackage(
    open=Mot3d,
    about=lambda card: DATASET,
    locate=lambda card, data: DATASET.status(data, folder_of(card)),
    inspect=inspect,
)
