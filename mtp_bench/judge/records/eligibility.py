"""Reasons why records are not ranked: other scenes, seeds, limits or weights than those that ship, or taken names.

Records on recorded scenes that are better than prediction from ground-truth tracks are held back, until a maintainer
has looked at them and states so in a signed level.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict

from ...core import clean_text
from ...scoring import (
    DEFINITIONS,
    SUBSETS,
    Subset,
    scene_key,
    why_not_on,
    why_unranked as why_entrant_unranked,
)
from ..gateway.limits import Limits
from .attestation import Checked, SignedLevel
from .evaluation import scorer_digest
from .record import LimitsPart, Record, ScenePart
from .shipped import (
    FOR_BASELINES,
    Shipped,
    baseline_digest,
    baselines,
    earlier_scorers,
    shipped,
)

SEEDS = (0, 1, 2)
LEAST_HIDDEN = 50  # hidden scenes that rank
NOT_ON_HIDDEN = "not scored on hidden scenes yet"
MOST_SETTINGS = 100  # characters of a reason that quotes settings
Ships = Callable[[str], Shipped | None]


def why_unranked(
    record: Record, level: SignedLevel | None = None, ships: Ships = shipped
) -> str | None:
    """Reason why a record is shown without a rank, in a few words; None if it is ranked.

    ``level``: its signed level; ``ships``: the shipped env of an id.
    """
    return (
        record.unfinished
        or why_entrant_unranked(record.row.budget, record.samples, record.env.observe)
        or why_not_comparable(record, ships)
        or _why_not_on_hidden(ships(record.env.id), level)
    )


def why_not_comparable(record: Record, ships: Ships = shipped) -> str | None:
    """Reason why the numbers of a record cannot be compared with those of others, in a few words; None if they can."""
    return next(_reasons(record, ships), None)


def why_not_genuine(record: Record) -> str | None:
    """Reason why a record with the name of a baseline is of another submission; None for all others."""
    known = baseline_digest(record.submission.name, record.submission.networks)
    if known in (None, record.submission.digest):
        return None
    return f"{record.submission.name!r} is the name of a baseline, and this is another submission"


def why_scored_otherwise(record: Record) -> str | None:
    """Reason why the scorer of a record gives other numbers than today's; None if it gives the same."""
    definitions = record.scorer.definitions
    if (definitions, record.scorer.source_digest) == (
        DEFINITIONS,
        scorer_digest(),
    ) or _scored_before(record):
        return None
    if definitions != DEFINITIONS:
        return f"scored by definitions {definitions}, today's are {DEFINITIONS}"
    return "another scorer than today's"


def _scored_before(record: Record) -> bool:
    """Return True if an earlier scorer with today's numbers made the record."""
    return (
        record.env.id,
        record.scorer.source_digest,
        record.reference.hash,
    ) in earlier_scorers()


def may_observe(record: Record) -> bool:
    """False if the record is not of a baseline, and its agent saw the true objects of detections."""
    known = baseline_digest(record.submission.name, record.submission.networks)
    return record.env.observe != "associated" or known == record.submission.digest


def taken_names(
    records: Sequence[Record], levels: Mapping[str, SignedLevel]
) -> dict[str, str]:
    """Reason why records of one env are not ranked because another submission has their name: by digest of the record.

    Of several submissions with one name, the only one with a signed level keeps it; without such a one, none does.
    """
    genuine = [
        (each.submission.name, each)
        for each in records
        if why_not_genuine(each) is None
    ]
    owners, signed = (
        defaultdict[str, set[str]](set),
        defaultdict[str, set[str]](set),
    )  # digests of submissions by name
    for name, record in genuine:
        owners[name].add(record.submission.digest)
        signed[name] |= {record.submission.digest} if record.digest in levels else set()
    return {
        record.digest: f"{len(owners[name])} submissions have the name {name!r}"
        for name, record in genuine
        if len(owners[name]) > 1 and signed[name] != {record.submission.digest}
    }


def held_back(one: Checked, truths: Sequence[Checked]) -> str | None:
    """Reason why a record is not ranked that is significantly better than each of ``truths``, all on one ranked subset.

    A table of the public scenes could make such a record. ``truths``: prediction from ground-truth tracks on the same
    units, with motion models and with the best network. A record on hidden scenes, or that was looked at, is never
    held back.
    """
    looked_at = one.signed is not None and one.signed.statement.looked_at
    if one.on_hidden or looked_at or not truths:
        return None
    ranked: Iterator[Subset] = (
        subset for subset in SUBSETS if why_not_on(subset, one.sums_on(subset)) is None
    )

    def is_better(truth: Checked, subset: Subset) -> bool:
        difference = one.minus(truth, subset)
        return difference is not None and difference.mean < 0 and difference.significant

    better = any(all(is_better(truth, subset) for truth in truths) for subset in ranked)
    return "better than ground truth: not ranked until looked at" if better else None


def _reasons(record: Record, ships: Ships) -> Iterator[str]:
    env, known = record.env, ships(record.env.id)
    yield from _unlike_shipped(record, known)
    if not record.reference.frozen and not _scored_before(
        record
    ):  # some weights were frozen later
        yield "other event weights than the frozen ones"
    if record.seeds != list(SEEDS):
        yield f"seeds {', '.join(map(str, record.seeds))}, ranks need {', '.join(map(str, SEEDS))}"
    if env.scenes != env.scenes_of_split:
        yield f"{env.scenes} of {env.scenes_of_split} scenes"
    if record.limits != LimitsPart(**asdict(Limits())):
        yield "other limits than those that rank"


def _why_not_on_hidden(known: Shipped | None, level: SignedLevel | None) -> str | None:
    """Reason why a record of a simulated env is not ranked, although its numbers on public scenes compare."""
    if known is None or not known.simulated:
        return None
    if level is None or (hidden := level.statement.hidden) is None:
        return NOT_ON_HIDDEN
    few = hidden.scenes < LEAST_HIDDEN
    return (
        f"scored on {hidden.scenes} hidden scenes, ranks need {LEAST_HIDDEN}"
        if few
        else None
    )


def _unlike_shipped(record: Record, known: Shipped | None) -> Iterator[str]:
    """Differences from the baselines, the scorer, the card and the event weights that ship."""
    other_submission = why_not_genuine(record)
    if other_submission is not None:
        yield other_submission
    if not may_observe(record):
        yield FOR_BASELINES
    baseline = baselines().get(record.submission.name)
    if baseline is not None and baseline.compare.observe != record.env.observe:
        yield f"observe is {record.env.observe!r}, the baseline of that name has {baseline.compare.observe!r}"
    if why := why_scored_otherwise(record):
        yield why
    if known is None:
        yield "its environment ships no event weights"
        return
    env = record.env
    if env.card_digest != known.card:
        yield f"card {env.card_digest}, the one that ships is {known.card}"
    given = env.keywords.items()
    other = [
        f"{name} {value!r}"
        for name, value in given
        if (name, value) != ("samples", known.samples)
    ]
    if other:
        yield f"other settings of the env: {clean_text(', '.join(other), MOST_SETTINGS)}"
    if record.samples != known.samples or any(
        row.budget != "equal" for row in record.rows
    ):
        yield f"{record.samples} samples per object, not the env's own k"
    if record.reference.hash != known.weights:
        yield "other event weights than the frozen ones"
    if env.scenes != len(known.sums):
        yield f"{env.scenes} of {len(known.sums)} scenes"
    unlike = next(
        (
            scene
            for scene in record.per_scene
            if not _has_weights_of(known, env.id, scene)
        ),
        None,
    )
    if unlike is not None:
        yield f"scene {unlike.scene!r} has other targets than its frozen event weights"


def _has_weights_of(known: Shipped, env_id: str, scene: ScenePart) -> bool:
    sums = known.sums.get(scene_key(env_id, scene.scene))
    return sums is not None and all(
        math.isclose(
            sum(scene.weight[subset]), sums[subset], rel_tol=1e-6, abs_tol=1e-6
        )
        for subset in SUBSETS
    )
