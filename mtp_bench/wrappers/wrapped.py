"""The task of the env that a wrapper is put around."""

from __future__ import annotations

from typing import Any

import gymnasium

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
