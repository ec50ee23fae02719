"""Runs of a submission as jobs for the runner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..submission.loader import Submission, SubmissionFactory
from .run import Job


def jobs_of(
    submission: Submission,
    env_id: str,
    keywords: dict[str, Any],
    scenes: Sequence[str],
    seed: int = 0,
    parameters: dict[str, Any] | None = None,
    label: str | None = None,
) -> list[Job]:
    """One job per scene: the submission with its own parameters, or others, in evaluation mode."""
    chosen = submission.parameters if parameters is None else parameters
    make = SubmissionFactory(str(submission.path), chosen)
    keywords = {"observe": submission.compare.observe, **keywords, "evaluation": True}
    return [Job(make, env_id, keywords, scene, seed, label or submission.name) for scene in scenes]
