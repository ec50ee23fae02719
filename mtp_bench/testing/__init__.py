"""Conformance suite for agents and cards.

::

    from mtp_bench import load_submission
    from mtp_bench.testing import check_agent

    errors = [finding for finding in check_agent(load_submission("mine").build) if finding.level == "error"]
"""

from __future__ import annotations

from .agent_checks import check_agent as check_agent
from .card_checks import check_card as check_card
from .findings import Finding as Finding
