"""Event weights that many tests need: the 48 runs of a scene are made once for all of them."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mtp_bench.cards import Card
from mtp_bench.env import MTPEnv
from mtp_bench.files import write_bytes
from mtp_bench.running import reference
from mtp_bench.running.perturbation import Perturbation
from mtp_bench.submission.loader import Submission

_perturbed_runs = reference._perturbed_runs


@dataclass(frozen=True)
class Remembered:
    """In place of `reference._perturbed_runs`: the same counts, from a folder if this scene was run so before."""

    folder: Path

    def __call__(
        self,
        card: Card,
        data: str | None,
        name: str,
        submission: Submission,
        perturbation: Perturbation,
        runs: Sequence[int],
    ) -> NDArray[np.uint8]:
        """Counts of the events of some runs on the targets of a scene [n, 4]."""
        env = MTPEnv(card, data=data, evaluation=True)
        env.reset(options={"scene": name})
        asked = pickle.dumps((card.digest, env.scene, submission.digest, perturbation, list(runs)))
        path = self.folder / f"runs-{hashlib.sha256(asked).hexdigest()}"
        if not path.exists():
            write_bytes(path, pickle.dumps(_perturbed_runs(card, data, name, submission, perturbation, runs)))
        counts: NDArray[np.uint8] = pickle.loads(path.read_bytes())
        return counts
