"""How much the score cut of the input decides: STP, MTP and their control with detections above several scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..env.environment import MTPEnv
from ..scoring import AgentScores, Reference, Report, summarise
from ..scoring.rows import Count, Interval
from ..strict import Section
from ..submission.loader import load_submission
from .options import DEFAULTS, RunOptions
from .reference import ranked_scenes
from .scored import score_settings
from .settings import setting_of

CUTS = (0.1, 0.2, 0.3)
AGENTS = ("stp", "mtp", "stp_same_budget")
PARAMETER = "min_detection_score"


class AtCut(Section):
    """What agents score with the detections of at least one score, by the event weights of all detections."""

    cut: float
    switches: Count  # of stp, on evaluated true boxes
    switches_on_targets: Count
    ids: dict[str, float | None]  # agent -> error, m
    all: dict[str, float | None]
    beyond_control: dict[str, float | None]  # subset -> mtp minus control, m
    interval: dict[str, Interval | None]
    p: dict[str, float | None]


def sensitivity(
    env_id: str, reference: Reference, options: RunOptions = DEFAULTS, cuts: Sequence[float] = CUTS
) -> list[AtCut]:
    """The baselines of `AGENTS` at each of the ``cuts``, on the same targets with the same weights.

    ``reference``: event weights of the scenes. Raises MtpBenchError for whatever the user can mend.
    """
    env = MTPEnv(env_id, **options.env_keywords)
    card, scenes = env.card, options.chosen(ranked_scenes(env.card, env.scene_names))
    settings = [setting_of(load_submission(name), card, {PARAMETER: cut}) for cut in cuts for name in AGENTS]
    scored = score_settings(settings, env_id, card, scenes, options)
    agents = [replace(each, agent=s.submission.name) for each, s in zip(scored, settings, strict=True)]
    per_cut = [agents[i : i + len(AGENTS)] for i in range(0, len(agents), len(AGENTS))]
    return [at_cut(cut, some, summarise(some, card, reference)) for cut, some in zip(cuts, per_cut, strict=True)]


def at_cut(cut: float, agents: Sequence[AgentScores], report: Report) -> AtCut:
    """What the agents of `AGENTS` score at one cut; ``report``: of them."""
    stp, mtp, control = AGENTS
    first = next(agent for agent in agents if agent.agent == stp).seeds[0]
    pairs = {r.subset: r for r in report.paired if (r.agent, r.other) == (mtp, control) and r.subset in ("all", "ids")}
    return AtCut(
        cut=cut,
        switches=sum(score.own_events["ids"] for score in first),
        switches_on_targets=int(np.sum([score.own_ids.sum() for score in first])),
        ids={row.agent: row.error for row in report.rows if row.subset == "ids"},
        all={row.agent: row.error for row in report.rows if row.subset == "all"},
        beyond_control={name: pair.error for name, pair in pairs.items()},
        interval={name: pair.interval for name, pair in pairs.items()},
        p={name: pair.p for name, pair in pairs.items()},
    )
