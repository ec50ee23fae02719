"""KITTI tracking: the official folders, read into scenes."""

from ..base import SourcePackage
from .files import DATASET, LABELS, KittiSource as KittiSource
from .poses import scene_images
from .source import FORM, KittiTracking

PACKAGE = SourcePackage(
    open=KittiTracking,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, LABELS),
    tracks=FORM,
    images=scene_images,
)
