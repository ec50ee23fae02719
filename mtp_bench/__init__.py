"""Tracking and prediction together: your agent sees detections, not the truth.

``import mtp_bench`` registers every card of ``envs/`` with Gymnasium::

    import gymnasium as gym, mtp_bench
    env = gym.make("MTP-KITTI-v0", data="/path/to/data")

What takes time to import is imported when it is first used, such as ``mtp_bench.tracking`` or ``mtp_bench.MTPEnv``.
"""

import importlib as _importlib
import typing as _typing

import gymnasium as _gymnasium

from ._bundle import card_ids as card_ids
from ._version import __version__ as __version__
from .errors import (
    ActionError as ActionError,
    CardError as CardError,
    DataError as DataError,
    MtpBenchError as MtpBenchError,
    RecordError as RecordError,
    RolloutError as RolloutError,
    ShapeError as ShapeError,
    SubmissionError as SubmissionError,
    UnknownNameError as UnknownNameError,
)

if _typing.TYPE_CHECKING:
    from . import (
        prediction as prediction,
        scoring as scoring,
        tracking as tracking,
        training as training,
        wrappers as wrappers,
    )
    from .agent import (
        Agent as Agent,
        Forecasts as Forecasts,
        Frame as Frame,
        FunctionPredictor as FunctionPredictor,
        Pipeline as Pipeline,
        Predictor as Predictor,
        Sampler as Sampler,
        Tracker as Tracker,
    )
    from .cards import Card as Card, load_card as load_card
    from .env.building import make_action as make_action
    from .env.environment import MTPEnv as MTPEnv
    from .running.compare import compare as compare, evaluate as evaluate
    from .running.stored import run as run, score as score
    from .scoring import Report as Report
    from .sources import load_scenes as load_scenes
    from .sources.files import save_scene as save_scene
    from .submission.loader import (
        Submission as Submission,
        load_submission as load_submission,
    )
    from .tracks import Objects as Objects, Tracks as Tracks
    from .training import windows as windows
    from .types import (
        Action as Action,
        Detections as Detections,
        Observation as Observation,
        Rollout as Rollout,
        Scene as Scene,
        Task as Task,
        Truth as Truth,
    )
else:  # hidden from type checkers, for which it would make every misspelt attribute legal
    _NAMES = {  # module -> its names, which are imported when they are first used
        "agent": (
            "Agent",
            "Forecasts",
            "Frame",
            "FunctionPredictor",
            "Pipeline",
            "Predictor",
            "Sampler",
            "Tracker",
        ),
        "cards": ("Card", "load_card"),
        "env.building": ("make_action",),
        "env.environment": ("MTPEnv",),
        "running.compare": ("compare", "evaluate"),
        "running.stored": ("run", "score"),
        "scoring": ("Report",),
        "sources": ("load_scenes",),
        "sources.files": ("save_scene",),
        "submission.loader": ("Submission", "load_submission"),
        "tracks": ("Objects", "Tracks"),
        "training": ("windows",),
        "types": (
            "Action",
            "Detections",
            "Observation",
            "Rollout",
            "Scene",
            "Task",
            "Truth",
        ),
    }
    _LAZY = {name: module for module, names in _NAMES.items() for name in names}
    _LAZY |= {
        name: name
        for name in ("prediction", "scoring", "tracking", "training", "wrappers")
    }

    def __getattr__(name: str) -> _typing.Any:
        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = _importlib.import_module(f".{_LAZY[name]}", __name__)
        return module if name == _LAZY[name] else getattr(module, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *_LAZY})


for _env_id in card_ids():
    if _env_id not in _gymnasium.registry:  # the module may be loaded anew
        _gymnasium.register(
            id=_env_id, entry_point="mtp_bench:MTPEnv", kwargs={"card": _env_id}
        )
