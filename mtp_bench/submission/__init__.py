"""Agents from outside: a folder with ``submission.toml``, ``agent.py`` and weights."""

from .loader import Submission as Submission
from .loader import SubmissionFactory as SubmissionFactory
from .loader import load_submission as load_submission
