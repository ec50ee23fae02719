"""Scoring: the definitions of the evaluation protocol as functions of arrays."""

from __future__ import annotations

from .clear import tracking_counts as tracking_counts
from .definitions import DEFINITIONS as DEFINITIONS
from .definitions import SUBSETS as SUBSETS
from .details import end_to_end_accuracy as end_to_end_accuracy
from .details import forecast_average_precision as forecast_average_precision
from .displacement import Displacement as Displacement
from .displacement import displacement as displacement
from .displacement import energy_score as energy_score
from .displacement import k_curve as k_curve
from .events import Events as Events
from .events import find_events as find_events
from .events import history as history
from .frame import FrameScore as FrameScore
from .frame import FrameScorer as FrameScorer
from .gaps import References as References
from .matching import match as match
from .matching import match_sticky as match_sticky
from .neutral import evaluated as evaluated
from .neutral import unconfirmable as unconfirmable
from .pairs import Pairs as Pairs
from .rank import rank_by_error as rank_by_error
from .report import Report as Report
from .report import summarise as summarise
from .score import SceneScore as SceneScore
from .score import mean_plain_error as mean_plain_error
from .score import score_scene as score_scene
from .statistics import bootstrap_interval as bootstrap_interval
from .statistics import effective_number as effective_number
from .statistics import paired_difference as paired_difference
from .statistics import sign_flip_test as sign_flip_test
from .table import AgentScores as AgentScores
from .table import stated_hypotheses as stated_hypotheses
from .targets import Targets as Targets
from .targets import find_targets as find_targets
from .targets import live_frames as live_frames
from .weights import Reference as Reference
from .weights_file import read_reference as read_reference
from .weights_file import write_reference as write_reference
