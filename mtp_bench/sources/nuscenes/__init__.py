"""nuScenes: official tables and detections in the submission form, as scenes."""

from ..base import SourcePackage
from .forecasts import FORMS
from .layout import DATASET, VERSIONS, NuScenesSource as NuScenesSource
from .pictures import scene_images, scene_lanes
from .source import FORM, NuScenes, prepare_nuscenes

PACKAGE = SourcePackage(
    open=NuScenes,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, VERSIONS),
    prepare=prepare_nuscenes,
    tracks=FORM,
    forecasts=FORMS,
    lanes=scene_lanes,
    images=scene_images,
)
