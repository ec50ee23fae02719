"""Tracking and prediction together: your agent sees detections, not the truth.

``import mtp_bench`` registers every card of ``envs/`` with Gymnasium::

    import gymnasium as gym, mtp_bench
    env = gym.make("MTP-KITTI-v0", data="/path/to/data")

``mtp_bench.scoring``, ``mtp_bench.tracking`` and ``mtp_bench.prediction`` are imported when they are first used.
"""

import importlib as _importlib
import typing as _typing

import gymnasium as _gymnasium

from ._bundle import card_ids as card_ids
from ._version import __version__ as __version__
from .agent import Action as Action
from .agent import Agent as Agent
from .agent import Observation as Observation
from .agent import Pipeline as Pipeline
from .cards import Card as Card
from .cards import load_card as load_card
from .errors import CardError as CardError
from .errors import DataError as DataError
from .errors import MtpBenchError as MtpBenchError
from .errors import RolloutError as RolloutError
from .errors import ShapeError as ShapeError
from .errors import SubmissionError as SubmissionError
from .errors import UnknownNameError as UnknownNameError
from .submission.loader import Submission as Submission
from .submission.loader import load_submission as load_submission
from .types import Detections as Detections
from .types import Rollout as Rollout
from .types import Scene as Scene
from .types import Task as Task
from .types import Truth as Truth

_LAZY = ("prediction", "scoring", "tracking")

if _typing.TYPE_CHECKING:
    from . import prediction as prediction
    from . import scoring as scoring
    from . import tracking as tracking
else:  # hidden from type checkers, for which it would make every misspelt attribute legal

    def __getattr__(name: str) -> _typing.Any:
        if name in _LAZY:
            return _importlib.import_module(f".{name}", __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *_LAZY})


def _register() -> None:
    for env_id in card_ids():
        if env_id not in _gymnasium.registry:  # the module may be loaded anew
            _gymnasium.register(id=env_id, entry_point="mtp_bench.env:MTPEnv", kwargs={"card": env_id})


_register()
