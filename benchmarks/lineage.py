"""Stated parents of hypotheses: whether they fit the pasts of the tracks, and what they change in events.

    python benchmarks/lineage.py --env MTP-PETS-v0 [--hypotheses 5 20] [--scenes N] [--data ROOT]

A parent fits where every track of a hypothesis that is older than the frame goes on from a track of that parent: its
past without the newest row is the other's past without the oldest. "guessed": the same rollouts without stated parents.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from mtp_bench import Observation, Pipeline, Tracks
from mtp_bench.env.environment import MTPEnv
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.running.playing import run_scene
from mtp_bench.scoring import AgentScores, SceneScore, score_scene, summarise
from mtp_bench.tracking import HypothesisTracker


class Watched(HypothesisTracker):
    """A tracker that counts the frames in which its stated parents fit."""

    frames = fitting = 0
    before: Tracks | None = None

    def step(self, observation: Observation) -> Tracks:
        """Tracks after this frame."""
        tracks = super().step(observation)
        if self.before is not None:
            self.frames += 1
            self.fitting += fits(self.before, tracks)
        self.before = tracks
        return tracks


def fits(before: Tracks, now: Tracks) -> bool:
    """True if every track that the parent hypothesis held too continues its state there.

    Tracks that are new, or that the parent had not seen often enough to output them, have nothing to fit.
    """
    if now.parent is None:
        return False
    for hypothesis, parent in zip(now.member, now.parent, strict=True):
        held = np.flatnonzero(before.member[parent])
        past = dict(
            zip(before.track_id[held].tolist(), before.past[held, 1:], strict=True)
        )
        for n in np.flatnonzero(hypothesis):
            known = past.get(int(now.track_id[n]))
            if known is not None and not np.array_equal(known, now.past[n, :-1]):
                return False
    return True


def main() -> None:
    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--env", required=True)
    parser.add_argument("--hypotheses", type=int, nargs="+", default=[5, 20])
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--data")
    given = parser.parse_args()
    table = Table(title=given.env)
    for column in (
        "H",
        "parents",
        "frames that fit",
        "ids",
        "lost",
        "reacquired",
        "ids in all",
        "frag in all",
    ):
        table.add_column(column, justify="right")
    for count in given.hypotheses:
        env = MTPEnv(given.env, data=given.data, evaluation=True)
        tracker = Watched(count)
        agent = Pipeline(tracker, KinematicPredictor(), KMeansSampler())
        stated: list[SceneScore] = []
        guessed: list[SceneScore] = []
        for name in env.scene_names[: given.scenes]:
            tracker.before = None
            rollout = run_scene(agent, env, name, 0)
            stated.append(score_scene(env.scene, rollout, env.card))
            unsaid = replace(
                rollout, hypothesis_parent=np.full_like(rollout.hypothesis_parent, -1)
            )
            guessed.append(score_scene(env.scene, unsaid, env.card))
        for label, scores in (("stated", stated), ("guessed", guessed)):
            detail = summarise(
                [
                    AgentScores(
                        "mtp", count, scores[0].samples, "equal", (tuple(scores),)
                    )
                ],
                env.card,
            ).details[0]
            own, share = (
                detail.own_events,
                f"{tracker.fitting} of {tracker.frames}" if label == "stated" else "",
            )
            everywhere = [
                sum(int(getattr(score, kind).sum()) for score in scores)
                for kind in ("all_h_ids", "all_h_frag")
            ]
            cells = (
                count,
                label,
                share,
                own["ids"],
                own["lost"],
                own["reacquired"],
                *everywhere,
            )
            table.add_row(*(str(cell) for cell in cells))
    Console().print(table)


if __name__ == "__main__":
    main()
