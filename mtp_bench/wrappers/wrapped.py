"""The task of the env that a wrapper is put around, and the check of a wrapper's numbers."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from ..errors import MtpBenchError, sentence
from ..types import Task


def task_of(env: gymnasium.Env[Any, Any], wrapper: str) -> Task:
    """The task of ``env``; MtpBenchError, which names the ``wrapper``, for an env of another library."""
    from ..env import MTPEnv

    inner = env.unwrapped
    if not isinstance(inner, MTPEnv):
        expected = 'one of mtp_bench, such as gym.make("MTP-Roundabout-v0")'
        raise MtpBenchError(sentence(f"the env is a {type(inner).__name__}", expected, wrapper))
    return inner.task


def require_own_space(env: gymnasium.Env[Any, Any], name: str, wrapper: str) -> None:
    """Raise MtpBenchError, which names the ``wrapper``, unless the space called ``name`` is that of the env below."""
    space = getattr(env, name)
    if not isinstance(space, gymnasium.spaces.Dict):
        got = f"the {name} of the env is a {type(space).__name__}"
        raise MtpBenchError(sentence(got, "the Dict that it has before another wrapper changes it", wrapper))


def require_positive(name: str, value: Any, wrapper: str, whole: bool = False) -> None:
    """Raise MtpBenchError, which names the ``wrapper``, unless ``value`` is a finite number above 0.

    ``whole``: a whole one.
    """
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, kinds) or not 0 < value < np.inf:
        expected = f"a {'whole' if whole else 'finite'} number above 0"
        raise MtpBenchError(sentence(f"{name} is {value!r}", expected, wrapper))
