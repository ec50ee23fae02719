"""Scoring: the definitions of the evaluation protocol as functions of arrays."""

from .clear import tracking_counts as tracking_counts
from .definitions import DEFINITIONS as DEFINITIONS, SUBSETS as SUBSETS
from .details import (
    end_to_end_accuracy as end_to_end_accuracy,
    forecast_average_precision as forecast_average_precision,
)
from .displacement import (
    Displacement as Displacement,
    displacement as displacement,
    energy_score as energy_score,
    k_curve as k_curve,
)
from .events import Events as Events, find_events as find_events, history as history
from .frame import FrameScore as FrameScore, FrameScorer as FrameScorer
from .matching import match as match, match_sticky as match_sticky
from .neutral import evaluated as evaluated, unconfirmable as unconfirmable
from .pairs import Pairs as Pairs
from .rank import References as References, rank_by_error as rank_by_error
from .report import Report as Report, summarise as summarise
from .score import (
    SceneScore as SceneScore,
    mean_plain_error as mean_plain_error,
    score_scene as score_scene,
)
from .statistics import (
    bootstrap_interval as bootstrap_interval,
    effective_number as effective_number,
    paired_difference as paired_difference,
)
from .table import AgentScores as AgentScores, stated_hypotheses as stated_hypotheses
from .targets import (
    Targets as Targets,
    find_targets as find_targets,
    live_frames as live_frames,
)
from .weights import Reference as Reference
from .weights_file import (
    read_reference as read_reference,
    write_reference as write_reference,
)
