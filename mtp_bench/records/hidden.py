"""A submission on hidden scenes: what ranks on simulated envs.

The scenes are made for a check, or for a round of them, and deleted after it: what lies in a cache could be read. Of
them only sums per unit are published, for the name of a scene tells its seed.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

from ..errors import RecordError
from ..gateway import Limits
from ..parallel import Progress
from ..scoring.subsets import SUBSETS
from ..sources import discard, keep_private, open_source
from .record import HiddenPart, Record
from .rerun import require_whole, run_again, why_not_isolated
from .running import Plan, evaluate_plan, isolation
from .seal import Sealed


def run_hidden(plan: Plan, record: Record, sealed: Sealed, limits: Limits, ends: ExitStack) -> HiddenPart:
    """What the submission of ``plan`` scores on the hidden scenes, under secret seeds in place of those of ``record``.

    They are made where they are not there yet, and deleted when ``ends`` is closed.

    Raises RecordError where the seal is of another card, or the system cannot hide files and network from an agent.
    """
    card = plan.card
    if (sealed.seeds.env, sealed.seeds.card_digest) != (card.id, card.digest):
        raise RecordError(
            f"the seal is of {sealed.seeds.env} with card digest {sealed.seeds.card_digest}, the record of {card.id} "
            f"with {card.digest}"
        )
    hidden = sealed.card(card)
    ends.callback(discard, hidden)
    keep_private(hidden)
    told = plan.options.progress
    progress = Progress(told.started, lambda _: told.done("a hidden scene"))  # its name would tell its seed
    names, options = sealed.shuffled(open_source(hidden).names), replace(plan.options, data=None, progress=progress)
    there = replace(plan, env=hidden, card=hidden, scenes=names, scenes_of_split=len(names), options=options)
    runs = run_again(there, list(sealed.run_seeds(record.seeds).values()), limits)
    why = why_not_isolated(record, isolation(runs))
    if why:
        raise RecordError(f"hidden scenes would not stay hidden: {why}; run it on Linux with user namespaces")
    require_whole(runs, plan.submission.name, "of hidden scenes")
    reference = sealed.reference(hidden, names, options)
    found = evaluate_plan(there, runs, reference)
    return HiddenPart(
        commitment=sealed.commitment,
        weights=reference.digest,
        scenes=len(names),
        rows=found.rows,
        silence=found.silence,
        weight={subset: [w for scene in found.per_scene for w in scene.weight[subset]] for subset in SUBSETS},
        error={subset: [e for scene in found.per_scene for e in scene.error[subset]] for subset in SUBSETS},
    )
