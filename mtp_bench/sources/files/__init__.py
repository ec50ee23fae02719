"""Own scenes: NPZ files, tables and `Scene` objects, read into scenes; and the one writer of them."""

from ..base import SourcePackage
from .source import OwnScenes
from .status import DATASET, files_status
from .writing import save_scene as save_scene

PACKAGE = SourcePackage(open=OwnScenes, about=lambda card: DATASET, describe=files_status)
