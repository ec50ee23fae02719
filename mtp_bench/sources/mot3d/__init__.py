"""3DMOT2015: people on the ground plane, one sequence read into scenes."""

from ..base import SourcePackage
from .source import Mot3d
from .status import about, folder_of, inspect

PACKAGE = SourcePackage(
    open=Mot3d,
    about=about,
    locate=lambda card, data: about(card).status(data, folder_of(card)),
    inspect=inspect,
)
