"""Conformance suite for agents and cards.

Findings of an agent: ``mtp_bench.running.conformance.check_agent(mtp_bench.load_submission("mine").build)``.
"""
