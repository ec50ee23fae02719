from .environment import MTPEnv as MTPEnv
from .episode import (
    Episode as Episode,
    LiveEpisode as LiveEpisode,
    frame_info as frame_info,
)
from .observation import (
    Feed as Feed,
    LocalFrame as LocalFrame,
    make_feed as make_feed,
    shown_boxes as shown_boxes,
    true_detections as true_detections,
    true_ids as true_ids,
)
from .rollouts import (
    ROLLOUT_ARRAYS as ROLLOUT_ARRAYS,
    RecordedAction as RecordedAction,
    actions_of as actions_of,
    assemble as assemble,
    digest as digest,
    drive_arrays as drive_arrays,
    drive_of as drive_of,
    empty_rollout as empty_rollout,
    log_softmax as log_softmax,
    record_action as record_action,
)
