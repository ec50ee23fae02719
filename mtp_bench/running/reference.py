"""The events that define the subsets of an env: frozen files, or made here from the reference baseline's run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._bundle import bundled, card_ids
from ..cards import Card, load_card
from ..env.environment import MTPEnv
from ..errors import UnknownNameError
from ..files import require_file
from ..scoring import ReferenceSubsets, SceneScore, read_reference, reference_subsets, score_scene, write_reference
from ..submission.loader import load_submission
from .options import DEFAULTS, RunOptions
from .run import jobs_of, run_jobs

KINDS = ("ids", "lost", "reacquired")  # of events


@dataclass(frozen=True)
class Reference:
    """Subsets of targets and where they come from."""

    subsets: ReferenceSubsets
    frozen: bool  # False: made in this run, for a split or data without a frozen file
    differing: int = 0  # events in which this run's own reference differs from the frozen one

    @property
    def origin(self) -> str:
        """One sentence for the report."""
        name, short = self.subsets.reference, self.subsets.hash[:12]
        if not self.frozen:
            return f"subsets from the events of {name!r} in this run (hash {short}), not the frozen ones of a ranking"
        text = f"frozen subsets of {name!r} (hash {short})"
        if not self.differing:
            return text
        events = "1 event" if self.differing == 1 else f"{self.differing} events"
        return f"{text}; {name!r} on this machine differs in {events}"


def frozen_path(env_id: str) -> Path:
    """Where the frozen subsets of an env are, if there are any."""
    return bundled("envs") / "reference" / f"{env_id}.json"


def frozen_reference(card: Card) -> Reference | None:
    """The frozen subsets of ``card``; None where there are none, as for a card that is not the shipped one."""
    path = frozen_path(card.id)
    if not path.is_file() or load_card(card.id).digest != card.digest:
        return None
    return Reference(read_reference(path, card), frozen=True)


def find_reference(card: Card, scores: Sequence[SceneScore]) -> Reference:
    """The frozen subsets of ``card``, else those of ``scores``, the scenes of the reference baseline.

    Raises DataError or CardError where the frozen file is broken.
    """
    made = reference_subsets(scores, card)
    reference = frozen_reference(card)
    if reference is None:
        return Reference(made, frozen=False)
    frozen = reference.subsets
    here = np.concatenate([score.truth_key for score in scores]) if scores else np.zeros(0, dtype=np.int64)
    differing = sum(len(np.setxor1d(made.keys(kind), np.intersect1d(frozen.keys(kind), here))) for kind in KINDS)
    return Reference(frozen, frozen=True, differing=differing)


def reference_of(card: Card, scores: Sequence[SceneScore], name: str) -> Reference:
    """The events of an agent other than the card's reference baseline."""
    return Reference(replace(reference_subsets(scores, card), reference=name), frozen=False)


def freeze(env_id: str, options: RunOptions = DEFAULTS) -> tuple[Path, dict[str, int]]:
    """Run the reference baseline of a shipped env and write its events as the frozen subsets; their path and counts.

    Raises UnknownNameError for the path of a card: its subsets would be found by no one.
    """
    if env_id not in card_ids():
        raise UnknownNameError("environment", env_id, card_ids(), "only those that ship have frozen subsets")
    card = load_card(env_id)
    path = frozen_path(env_id)
    path.parent.mkdir(exist_ok=True)
    require_file(path)
    names = MTPEnv(env_id, data=options.data).scene_names
    jobs = jobs_of(load_submission(card.reference), env_id, {"data": options.data}, names)
    subsets = reference_subsets(run_jobs(jobs, options, score_scene), card)
    write_reference(path, subsets)
    return path, {kind: len(subsets.keys(kind)) for kind in KINDS}
