"""KITTI tracking: the official folders, read into scenes."""

from ..base import SourcePackage
from .images import scene_images
from .layout import DATASET
from .source import KittiTracking
from .status import kitti_status
from .tracks import FORM

PACKAGE = SourcePackage(
    open=KittiTracking,
    about=lambda card: DATASET,
    describe=kitti_status,
    tracks=FORM,
    images=scene_images,
)
