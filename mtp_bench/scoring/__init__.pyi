from .bade import ONE_PER_TARGET as ONE_PER_TARGET, CardBudget as CardBudget
from .definitions import (
    DEFINITIONS as DEFINITIONS,
    FIXED_CONFIDENCE as FIXED_CONFIDENCE,
    GOLDEN as GOLDEN,
    KNOWN_SUBSETS as KNOWN_SUBSETS,
    RANKED_OBJECTS as RANKED_OBJECTS,
    RANKED_SUBSETS as RANKED_SUBSETS,
    RANKED_UNITS as RANKED_UNITS,
    SIGNIFICANT as SIGNIFICANT,
    SUBSETS as SUBSETS,
    WEIGHTS_DEFINITIONS as WEIGHTS_DEFINITIONS,
    Subset as Subset,
)
from .details import (
    calibration as calibration,
    end_to_end_accuracy as end_to_end_accuracy,
    forecast_average_precision as forecast_average_precision,
)
from .displacements import (
    Displacement as Displacement,
    displacement as displacement,
    drop_light_samples as drop_light_samples,
    energy_score as energy_score,
    k_curve as k_curve,
)
from .driving import (
    DRIVE_SCORE_WEIGHTS as DRIVE_SCORE_WEIGHTS,
    AgentDrives as AgentDrives,
    DrivingRow as DrivingRow,
    driving_rows as driving_rows,
    fault_interval as fault_interval,
    scene_score as scene_score,
    scene_scores as scene_scores,
    score_interval as score_interval,
)
from .events import (
    HOLES as HOLES,
    LOST_TARGETS as LOST_TARGETS,
    history as history,
    object_history as object_history,
    pieces as pieces,
    separated_truth as separated_truth,
)
from .forecasts import (
    Candidates as Candidates,
    RecordedForecasts as RecordedForecasts,
    match_by_confidence as match_by_confidence,
    match_neutral_last as match_neutral_last,
    match_objects as match_objects,
    near_truth as near_truth,
    sample_weights as sample_weights,
)
from .frame import FrameScore as FrameScore, FrameScorer as FrameScorer
from .lineage import (
    Hypotheses as Hypotheses,
    event_pairs as event_pairs,
    gated_pairs as gated_pairs,
    hypotheses as hypotheses,
    lineage_events as lineage_events,
    match_hypotheses as match_hypotheses,
)
from .matching import (
    columns_to_rows as columns_to_rows,
    match as match,
    match_sticky as match_sticky,
)
from .official import (
    OFFICIAL_STEPS as OFFICIAL_STEPS,
    official_rows as official_rows,
    official_scene as official_scene,
)
from .pairs import (
    Pairs as Pairs,
    box_pairs as box_pairs,
    keep_columns as keep_columns,
    near_pairs as near_pairs,
)
from .parts import (
    BELOW_THRESHOLD as BELOW_THRESHOLD,
    LEAST_SHOWN as LEAST_SHOWN,
    PART_NAMES as PART_NAMES,
    PARTS as PARTS,
    STAGE_NAMES as STAGE_NAMES,
    STAGE_PARTS as STAGE_PARTS,
    SceneParts as SceneParts,
    blame as blame,
    by_fault as by_fault,
    error_parts as error_parts,
    named_parts as named_parts,
    parts_text as parts_text,
    plain_parts as plain_parts,
    reference_errors as reference_errors,
    thresholds_of as thresholds_of,
)
from .rank import (
    ASSOCIATED as ASSOCIATED,
    FROM_FILE as FROM_FILE,
    NO_GAP as NO_GAP,
    NOT_CAUSAL as NOT_CAUSAL,
    NOT_KINEMATIC as NOT_KINEMATIC,
    REFERENCES_UNSTATED as REFERENCES_UNSTATED,
    SAW_TRUTH as SAW_TRUTH,
    GapPair as GapPair,
    GapPairs as GapPairs,
    Place as Place,
    References as References,
    guard_reason as guard_reason,
    places_on as places_on,
    rank_by_error as rank_by_error,
    span_text as span_text,
    why_not_on as why_not_on,
    why_unranked as why_unranked,
)
from .report import paired_row as paired_row, summarise as summarise
from .report_tables import (
    SUBSET_NAMES as SUBSET_NAMES,
    Report as Report,
    blocks_of as blocks_of,
    data_frame as data_frame,
    heading as heading,
    main_settings as main_settings,
    main_table as main_table,
    place_of as place_of,
    preference as preference,
    rejected_line as rejected_line,
    shipped_env as shipped_env,
    shipped_env_id as shipped_env_id,
)
from .rows import (
    AgentSetting as AgentSetting,
    Bin as Bin,
    Budget as Budget,
    Clear as Clear,
    Count as Count,
    Details as Details,
    Interval as Interval,
    IntervalColumn as IntervalColumn,
    Metres as Metres,
    OfficialRow as OfficialRow,
    PairedRow as PairedRow,
    Point as Point,
    Probability as Probability,
    Reliability as Reliability,
    Row as Row,
    Share as Share,
)
from .score import (
    SceneScore as SceneScore,
    check_rollout as check_rollout,
    mean_plain_error as mean_plain_error,
    score_scene as score_scene,
)
from .statistics import (
    PairedDifference as PairedDifference,
    UnitSums as UnitSums,
    bootstrap_interval as bootstrap_interval,
    effective_number as effective_number,
    numbers_of as numbers_of,
    paired_difference as paired_difference,
    ratio as ratio,
    share_interval as share_interval,
)
from .table import (
    AgentScores as AgentScores,
    AgentTable as AgentTable,
    SceneResult as SceneResult,
    agent_table as agent_table,
    stated_hypotheses as stated_hypotheses,
)
from .targets import (
    Targets as Targets,
    absent_causes as absent_causes,
    count_holes as count_holes,
    evaluated as evaluated,
    find_targets as find_targets,
    live_frames as live_frames,
    neutral_places as neutral_places,
    unlabelled as unlabelled,
)
from .weights import (
    COUNTED_EVENTS as COUNTED_EVENTS,
    EVENT_KINDS as EVENT_KINDS,
    WEIGHTED_SUBSETS as WEIGHTED_SUBSETS,
    Reference as Reference,
    SceneWeights as SceneWeights,
    count_runs as count_runs,
    read_reference as read_reference,
    scene_key as scene_key,
    tracking_events as tracking_events,
    write_reference as write_reference,
)
