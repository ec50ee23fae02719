"""Own scenes: tables in a folder, or `Scene` objects."""

from ..base import SourcePackage
from .save import save_scene as save_scene
from .source import DATASET, OwnScenes, files_status

PACKAGE = SourcePackage(
    open=OwnScenes,
    dataset=DATASET,
    locate=files_status,
    images=lambda card, data, scene: OwnScenes(card).images(scene.name),
)
