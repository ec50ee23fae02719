"""nuScenes: official tables and detections in the submission form, as scenes."""

from ..base import SourcePackage
from .cameras import scene_images
from .layout import DATASET, VERSIONS, NuScenesSource as NuScenesSource
from .road import scene_lanes
from .source import NuScenes, prepare_nuscenes
from .tracks import FORM

PACKAGE = SourcePackage(
    open=NuScenes,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, VERSIONS),
    prepare=prepare_nuscenes,
    tracks=FORM,
    lanes=scene_lanes,
    images=scene_images,
)
