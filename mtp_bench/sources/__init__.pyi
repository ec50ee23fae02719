from .argoverse2.files import Argoverse2Source as Argoverse2Source
from .argoverse2.submission import tracking_submission as tracking_submission
from .base import (
    CameraImage as CameraImage,
    SceneSource as SceneSource,
    SourcePackage as SourcePackage,
    StoredForecasts as StoredForecasts,
    Work as Work,
    class_ids as class_ids,
    no_detections as no_detections,
    require_classes as require_classes,
    section_of as section_of,
    usual_sizes as usual_sizes,
)
from .cache import (
    Arrays as Arrays,
    read_arrays as read_arrays,
    scene_digest as scene_digest,
    write_arrays as write_arrays,
    write_npz as write_npz,
)
from .d123.logs import import_logs as import_logs
from .dataset import (
    Dataset as Dataset,
    DataStatus as DataStatus,
    data_root as data_root,
)
from .detector_errors import (
    covered_truth as covered_truth,
    detection_matches as detection_matches,
    perturbed as perturbed,
)
from .files.columns import BOX_COLUMNS as BOX_COLUMNS
from .files.save import save_scene as save_scene
from .kitti.files import KITTI_TYPES as KITTI_TYPES, KittiSource as KittiSource
from .kitti.source import poses_of as poses_of, result_lines as result_lines
from .nuscenes.layout import NuScenesSource as NuScenesSource
from .nuscenes.lidar import (
    LidarPose as LidarPose,
    lidar_pose as lidar_pose,
    to_global as to_global,
    to_lidar as to_lidar,
)
from .nuscenes.source import NuScenes as NuScenes, submission_box as submission_box
from .opening import (
    camera_images as camera_images,
    describe as describe,
    load_scenes as load_scenes,
    open_source as open_source,
    package_of as package_of,
    prepare as prepare,
    with_map as with_map,
    with_tracks as with_tracks,
)
from .readers import write_table as write_table
from .simulated import detected as detected, in_world as in_world
from .stored_forecasts import forecast_forms as forecast_forms
from .stored_tracks import table_path as table_path
