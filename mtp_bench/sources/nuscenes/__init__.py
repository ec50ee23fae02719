"""nuScenes: the official tables and detections in the official submission form, read into scenes."""

from ..base import SourcePackage
from .cameras import scene_images
from .layout import DATASET
from .road import scene_lanes
from .source import NuScenes, prepare_nuscenes
from .status import nuscenes_status
from .tracks import FORM

PACKAGE = SourcePackage(
    open=NuScenes,
    about=lambda card: DATASET,
    describe=nuscenes_status,
    prepare=prepare_nuscenes,
    tracks=FORM,
    lanes=scene_lanes,
    images=scene_images,
)
