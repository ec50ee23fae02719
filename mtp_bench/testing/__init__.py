"""Conformance suite for agents and cards.

Findings of an agent: ``mtp_bench.testing.check_agent(mtp_bench.load_submission("mine").build)``.
"""

from .agent_checks import check_agent as check_agent
from .card_checks import check_card as check_card
from .playing import Finding as Finding
