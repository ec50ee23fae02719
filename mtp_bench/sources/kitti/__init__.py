"""KITTI tracking: the official folders, read into scenes."""

from ..base import SourcePackage
from .image import scene_images
from .layout import DATASET, LABELS
from .layout import KittiSource as KittiSource
from .source import KittiTracking
from .tracks import FORM

PACKAGE = SourcePackage(
    open=KittiTracking,
    about=lambda card: DATASET,
    locate=lambda card, data: DATASET.status(data, LABELS),
    tracks=FORM,
    images=scene_images,
)
