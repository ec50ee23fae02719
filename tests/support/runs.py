"""Agents that a function makes, run through scenes by their names, and limits for those in processes of their own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.cards import Card
from mtp_bench.core.parallel import Workers
from mtp_bench.judge import Limits
from mtp_bench.running.options import DEFAULTS, RunOptions
from mtp_bench.running.playing import Finish, Job, MakeAgent, run_jobs
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import Reference
from mtp_bench.tracking.kernels.cache import cache_folder

PATIENT = Limits(start=600.0, reset=600.0, first_frame=600.0, frame=600.0)  # no agent is late on a busy machine

_made: dict[tuple[str, str | None, tuple[str, ...]], Reference] = {}


def remembered_reference(card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS) -> Reference:
    """As `reference_for`; the weights of a card, data and scenes are made once."""
    key = (card.digest, options.data, tuple(scenes))
    if key not in _made:
        _made[key] = reference_for(card, scenes, options)
    return _made[key]


def run_scenes(
    make_agent: MakeAgent, env_id: str, keywords: dict[str, Any], names: Sequence[str], seed: int = 0, workers: int = 1,
    finish: Finish | None = None,
) -> list[Any]:  # fmt: skip
    """Results of ``finish`` on each scene in the order of ``names``; if None, the rollouts."""
    jobs = [Job(make_agent, env_id, {**keywords, "evaluation": True}, scene, seed, "mine") for scene in names]
    return run_jobs(jobs, RunOptions(workers=Workers(workers)), finish)


def move_home(home: Path, patch: pytest.MonkeyPatch) -> None:
    """Another home folder; compiled kernels stay where they are, else every process there compiled them anew."""
    patch.setenv("NUMBA_CACHE_DIR", str(cache_folder()))
    patch.setenv("HOME", str(home))
