"""Scoring: the definitions of the evaluation protocol as functions of arrays."""

from __future__ import annotations

from .clear import tracking_counts as tracking_counts
from .definitions import DEFINITIONS as DEFINITIONS
from .details import end_to_end_accuracy as end_to_end_accuracy
from .details import forecast_average_precision as forecast_average_precision
from .displacement import Displacement as Displacement
from .displacement import displacement as displacement
from .displacement import energy_score as energy_score
from .displacement import k_curve as k_curve
from .error import mean_error as mean_error
from .events import EventList as EventList
from .events import Events as Events
from .events import find_events as find_events
from .events import history as history
from .forecasts import frame_error as frame_error
from .matching import match as match
from .matching import match_sticky as match_sticky
from .neutral import evaluated as evaluated
from .neutral import unconfirmable as unconfirmable
from .pairs import Pairs as Pairs
from .rank import shared_ranks as shared_ranks
from .report import Report as Report
from .report import summarise as summarise
from .score import SceneScore as SceneScore
from .score import score_scene as score_scene
from .statistics import bootstrap_interval as bootstrap_interval
from .statistics import paired_difference as paired_difference
from .statistics import paired_interval as paired_interval
from .statistics import sign_flip_test as sign_flip_test
from .subsets import SUBSETS as SUBSETS
from .subsets import ReferenceSubsets as ReferenceSubsets
from .subsets import masks as masks
from .subsets import read_reference as read_reference
from .subsets import reference_subsets as reference_subsets
from .subsets import write_reference as write_reference
from .table import AgentScores as AgentScores
from .table import stated_hypotheses as stated_hypotheses
from .targets import Targets as Targets
from .targets import find_targets as find_targets
