"""Weights of an entry: those that ship, and those that a command trains first."""

from __future__ import annotations

import re

from .entries import Entry, is_baseline

_FILE = re.compile(r"([a-z]\w*)-(truth|tracklets)-(MTP-[\w-]+)\.safetensors")  # as `networks.file_name` writes it
MINUTES = {
    "modes-truth": 1, "modes-tracklets": 2, "tracking_free-tracklets": 4, "affinity-tracklets": 5, "ptp-truth": 54,
}  # fmt: skip


def training_commands(entry: Entry) -> list[str]:
    """Commands that train the networks of an entry, in the record's order; empty where all of its weights ship."""
    files = (_FILE.fullmatch(name) for name in entry.record.submission.networks)
    return [f"mtp-bench train predictor {file[1]} --on {file[2]} --env {file[3]}" for file in files if file]


def weights_text(entry: Entry) -> str | None:
    """Return "ships" or "train in 4 min"; None for a submission that is not a baseline and lists no network."""
    files = [file for name in entry.record.submission.networks if (file := _FILE.fullmatch(name))]
    if not files:
        return "ships" if is_baseline(entry.record) else None
    minutes = [MINUTES.get(f"{file[1]}-{file[2]}") for file in files]
    return "train" if None in minutes else f"train in {sum(filter(None, minutes))} min"
