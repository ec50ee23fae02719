"""Subsets of the targets: weights from 0 to 1 over one array (docs/definitions, "Events")."""

from __future__ import annotations

from typing import Literal, get_args

Subset = Literal["all", "ids", "lost", "reacquired", "frag", "paper_ids", "paper_frag"]
SUBSETS: tuple[Subset, ...] = get_args(Subset)
