"""Conformance suite for agents and cards.

For the findings of an agent call `check_agent` of `mtp_bench.running` with
``mtp_bench.load_submission("mine").build``.
"""
