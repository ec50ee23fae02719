"""Agents from outside: a folder with ``submission.toml``, ``agent.py`` and weights."""

from .loader import (
    Submission as Submission,
    SubmissionFactory as SubmissionFactory,
    load_submission as load_submission,
)
