"""KITTI tracking: the official folders, read into scenes."""

from ..base import SourcePackage
from .files import DATASET, LABELS, KittiSource as KittiSource
from .poses import scene_images
from .source import FORM, KittiTracking

PACKAGE = SourcePackage(
    KittiTracking,
    DATASET,
    lambda card, data: DATASET.status(data, LABELS),
    FORM,
    images=scene_images,
)
