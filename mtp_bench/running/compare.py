"""Agents side by side on one env, always with the controls that tell hypotheses from sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..cards import Card
from ..env.environment import MTPEnv
from ..scoring import Ends, Reference, Report, summarise
from .options import DEFAULTS, RunOptions
from .reading import total_skipped
from .reference import ranked_scenes, reference_for
from .scored import score_settings
from .settings import Setting, all_settings, require_list

TRUTH, STP = "truth_past", "stp"
CONTROLS = (TRUTH, STP, "stp_same_budget", "stp_hedged")  # protocol, "Controls that every comparison prints"


@dataclass(frozen=True)
class Comparison:
    """A comparison, and the event weights of its subsets."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def compare(names: Sequence[str], env_id: str | Card, options: RunOptions = DEFAULTS) -> Comparison:
    """Run and score the controls and other agents on the scenes of an env.

    Args:
        names: Folders of submissions, or names of baselines.
        env_id: Id of the env, path of its card, or a card.
        options: Data, scenes, seeds, changes of the card, workers and progress.

    Event weights are the frozen ones of the env, else made from these scenes. Raises MtpBenchError for whatever the
    user can mend.
    """
    require_list(names)
    env = MTPEnv(env_id, **options.env_keywords)
    card, ranked = env.card, ranked_scenes(env.card, env.scene_names)  # a broken file of weights shows before all else
    scenes = options.chosen(ranked)
    settings = all_settings([*CONTROLS, *names], card)
    options.require_tracks_used([setting.submission for setting in settings])
    ends = {s.label: s.ends for s in settings if s.budget == "equal" and s.ends is not None}
    further = [end for pair in ends.values() for end in pair]
    further = [end for i, end in enumerate(further) if end not in further[:i]]  # settings of a sweep share their ends
    for end in further:  # they run last: a misspelt parameter shows before anything runs
        end.submission.require_parameters(**end.parameters)
    agents = score_settings([*settings, *further], env_id, card, scenes, options)
    of_end = agents[len(settings) :]
    own = {name: Ends(*(of_end[further.index(end)] for end in pair)) if pair else None for name, pair in ends.items()}
    reference = reference_for(card, scenes, options)
    report = summarise(agents[: len(settings)], card, reference, stp=STP, truth=TRUTH, own_ends=own)
    report.condition.update(_notes(settings, card.id))
    if len(ranked) < len(env.scene_names):
        left = f"{len(env.scene_names) - len(ranked)} of {len(env.scene_names)} scenes of the split have none"
        report.condition["weights"] += f"; {left} and are left out"
    skipped = total_skipped(score.skipped for score in agents[0].seeds[0])  # every setting reads the same scenes
    return Comparison(report, reference, tuple(settings), skipped)


def _notes(settings: Sequence[Setting], env_id: str) -> dict[str, str]:
    """Who was trained on what these scores are of, under the one key "trained"; nothing where nobody was."""
    told: dict[str, list[str]] = {}
    for submission in {s.submission.name: s.submission for s in settings}.values():
        note = submission.note_on(env_id)
        if note is not None:
            told.setdefault(note, []).append(submission.name)
    return {"trained": "; ".join(f"{note}: {', '.join(names)}" for note, names in told.items())} if told else {}
