from .greedy import GreedySampler as GreedySampler
from .k_means import KMeansSampler as KMeansSampler
from .kalman import (
    NoiseTable as NoiseTable,
    filter_tracks as filter_tracks,
    heading_frame as heading_frame,
    noise_table as noise_table,
    observed_condition as observed_condition,
    stored_noise as stored_noise,
)
from .kinematic import (
    HedgedPredictor as HedgedPredictor,
    KinematicPredictor as KinematicPredictor,
)
from .lanes import LanePredictor as LanePredictor
from .learned.modes import straight_future as straight_future
from .learned.network import (
    Network as Network,
    Sizes as Sizes,
    Stage as Stage,
    network_of as network_of,
    networks as networks,
    require_lanes as require_lanes,
)
from .learned.predictor import (
    LearnedPredictor as LearnedPredictor,
    StoredWeights as StoredWeights,
    write_weights as write_weights,
)
from .learned.ptp import (
    code_posterior as code_posterior,
    context_of as context_of,
    decode_futures as decode_futures,
    sample_codes as sample_codes,
)
from .presence import (
    PRESENCE_FEATURES as PRESENCE_FEATURES,
    LearnedPresence as LearnedPresence,
    Origin as Origin,
    PresenceModel as PresenceModel,
    TrackHistory as TrackHistory,
    history_of as history_of,
    logistic as logistic,
)
from .windows import (
    LANE_FIELDS as LANE_FIELDS,
    Arrays as Arrays,
    Surroundings as Surroundings,
    TrackWindows as TrackWindows,
    lanes_of as lanes_of,
    local_future as local_future,
    local_inputs as local_inputs,
    to_absolute as to_absolute,
    windows_of as windows_of,
)
