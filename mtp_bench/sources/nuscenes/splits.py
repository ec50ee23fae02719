"""Official scene lists; those of the prediction challenge cut "train" once more."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

SPLITS = ("train", "train_val", "val", "mini_train", "mini_val")
TRAIN_VAL = 200  # scenes: the prediction challenge validates on the first of the official "train"


@cache
def official_scenes() -> Mapping[str, tuple[str, ...]]:
    """Scene names of each of `SPLITS`, in the official order (``nuscenes.eval.prediction.splits``)."""
    lists = json.loads(Path(__file__).with_name("splits.json").read_text(encoding="utf-8"))
    train = lists["train"]
    named = {**lists, "train": train[TRAIN_VAL:], "train_val": train[:TRAIN_VAL]}
    return MappingProxyType({split: tuple(named[split]) for split in SPLITS})


def split_scenes(split: str, scenes: Collection[str]) -> tuple[str, ...]:
    """Those of ``scenes`` that are in ``split``, in its order; "all" has every one, sorted."""
    if split == "all":
        return tuple(sorted(scenes))
    there = frozenset(scenes)
    return tuple(name for name in official_scenes()[split] if name in there)


def splits_of(scenes: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The splits that have any of ``scenes``, "all" the last."""
    named = {split: split_scenes(split, scenes) for split in (*SPLITS, "all")}
    return {split: names for split, names in named.items() if names}


def counted(splits: Mapping[str, Collection[str]]) -> str:
    """The splits in words; "all" only where there is no other."""
    named = [split for split in splits if split != "all"] or list(splits)
    return ", ".join(f"{split} ({len(splits[split])} scene{'s' * (len(splits[split]) != 1)})" for split in named)
