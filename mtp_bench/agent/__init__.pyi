from .action import (
    ABSENT_LOG_WEIGHT as ABSENT_LOG_WEIGHT,
    ACTION_FIELDS as ACTION_FIELDS,
    COORDINATE_LIMIT as COORDINATE_LIMIT,
    FORECAST_REACH as FORECAST_REACH,
    ROW_KINDS as ROW_KINDS,
    SIZE_LIMIT as SIZE_LIMIT,
    ActionField as ActionField,
    RowKind as RowKind,
    pad_rows as pad_rows,
)
from .building import make_action as make_action
from .checks import (
    ActionProblem as ActionProblem,
    CheckedAction as CheckedAction,
    check_action as check_action,
)
from .loader import (
    ON_SCORED as ON_SCORED,
    ObjectSubmission as ObjectSubmission,
    Submission as Submission,
    SubmissionFactory as SubmissionFactory,
    controls as controls,
    load_submission as load_submission,
    missing_methods as missing_methods,
    submission_of as submission_of,
)
from .manifest import (
    MANIFEST as MANIFEST,
    PART_SUFFIX as PART_SUFFIX,
    ROLLOUTS_SUFFIX as ROLLOUTS_SUFFIX,
    Role as Role,
    SubmissionName as SubmissionName,
)
from .pipeline import Pipeline as Pipeline
from .protocols import (
    Action as Action,
    Agent as Agent,
    Forecasts as Forecasts,
    Frame as Frame,
    FunctionPredictor as FunctionPredictor,
    Objects as Objects,
    Observation as Observation,
    Predictor as Predictor,
    Presence as Presence,
    Sampler as Sampler,
    Tracker as Tracker,
    Tracks as Tracks,
)
from .row_checks import is_present as is_present
from .submission_files import (
    digest_of as digest_of,
    files_of as files_of,
    new_submission as new_submission,
)
