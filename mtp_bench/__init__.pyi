from . import (
    prediction as prediction,
    scoring as scoring,
    tracking as tracking,
    training as training,
    wrappers as wrappers,
)
from .agent import (
    Action as Action,
    Agent as Agent,
    Forecasts as Forecasts,
    Frame as Frame,
    FunctionPredictor as FunctionPredictor,
    Objects as Objects,
    Observation as Observation,
    Pipeline as Pipeline,
    Predictor as Predictor,
    Sampler as Sampler,
    Submission as Submission,
    Tracker as Tracker,
    Tracks as Tracks,
    load_submission as load_submission,
    make_action as make_action,
)
from .cards import Card as Card, load_card as load_card
from .core import (
    ActionError as ActionError,
    CardError as CardError,
    DataError as DataError,
    Detections as Detections,
    MtpBenchError as MtpBenchError,
    RecordError as RecordError,
    Rollout as Rollout,
    RolloutError as RolloutError,
    Scene as Scene,
    ShapeError as ShapeError,
    SubmissionError as SubmissionError,
    Task as Task,
    Truth as Truth,
    UnknownNameError as UnknownNameError,
    __version__ as __version__,
    card_ids as card_ids,
)
from .env import MTPEnv as MTPEnv
from .running import (
    check_agent as check_agent,
    compare as compare,
    doctor as doctor,
    evaluate as evaluate,
    import_forecasts as import_forecasts,
    robustness as robustness,
    run as run,
    score as score,
)
from .scoring import Report as Report
from .sources import load_scenes as load_scenes, save_scene as save_scene
from .training import windows as windows
