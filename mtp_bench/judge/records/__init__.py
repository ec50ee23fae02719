"""Leaderboard records: results of a submission, how they were measured, and checks.

A record is a JSON file with a digest of its own, which shows careless changes and is
not a signature. A forged record is found when its stored rollouts are scored again
(`verify`), and when its submission is run again. The level that was reached is signed,
and stands in the same file.
"""
