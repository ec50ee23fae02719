"""Reasons why records are not ranked.

They have other scenes, seeds, limits or weights than those that ship, or taken names.

Records on recorded scenes that are better than prediction from ground-truth tracks are
held back, until a maintainer has looked at them and states so in a signed level.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from ...core import baseline_names, clean_text
from ...scoring import (
    DEFINITIONS,
    SUBSETS,
    Subset,
    scene_key,
    why_not_on,
    why_unranked as why_entrant_unranked,
)
from ..gateway.limits import Limits
from .attestation import Checked
from .evaluation import scorer_digest
from .record import HiddenPart, Record
from .shipped import (
    FOR_BASELINES,
    Shipped,
    baseline_digest,
    baselines,
    earlier_cards,
    earlier_scorers,
    shipped,
)

SEEDS = (0, 1, 2)
LEAST_HIDDEN = 50  # hidden scenes that rank
NOT_ON_HIDDEN = "not scored on hidden scenes yet"
_TOLERANCE = 1e-6  # of sums of weights, absolute and relative
_MAX_SETTINGS = 100  # characters of a reason that quotes settings


def why_unranked(record: Record, hidden: HiddenPart | None = None) -> str | None:
    """Return the reason why a record has no rank, in a few words.

    None if it has one. ``hidden``: its results on hidden scenes.
    """
    return (
        record.unfinished
        or why_entrant_unranked(
            budget="equal", samples=record.samples, observe=record.env.observe
        )
        or why_not_comparable(record)
        or _why_not_on_hidden(record, hidden)
    )


def why_not_comparable(record: Record) -> str | None:
    """Return the reason why the numbers of a record do not compare with others.

    The reason has a few words. None if the numbers compare.
    """
    return next(_not_comparable_reasons(record), None)


def why_not_genuine(record: Record) -> str | None:
    """Return the reason why a record with a baseline's name is of another submission.

    None for all others.
    """
    name = record.submission.name
    if name not in baseline_names() or is_baseline(record):
        return None
    return f"{name!r} is the name of a baseline, and this is another submission"


def why_scored_otherwise(record: Record) -> str | None:
    """Return the reason why the scorer of a record gives other numbers than today's.

    None if it gives the same.
    """
    definitions = record.scorer.definitions
    scorer = (definitions, record.scorer.source_digest)
    if scorer == (DEFINITIONS, scorer_digest()) or _scored_before(record):
        return None
    if definitions != DEFINITIONS:
        return f"scored by definitions {definitions}, today's are {DEFINITIONS}"
    return "another scorer than today's"


def _scored_before(record: Record) -> bool:
    """Return True if an earlier scorer with today's numbers made the record."""
    scorer = record.scorer.source_digest
    return (record.env.id, scorer, record.reference.hash) in earlier_scorers()


def is_baseline(record: Record) -> bool:
    """Return True for a baseline, not another submission of its name."""
    submission = record.submission
    digest = baseline_digest(submission.name, submission.networks)
    return digest == submission.digest


def may_observe(record: Record) -> bool:
    """Return False if another agent than a baseline saw labels of detections."""
    return record.env.observe != "associated" or is_baseline(record)


def taken_names(records: Sequence[Checked]) -> dict[str, str]:
    """Return reasons why records of one env are not ranked, by their digests.

    Another submission has the same name. Of several the only one with a checked level
    keeps it; without such a one, none does.
    """
    genuine_records = []
    # digests of submissions by name
    name_owners = defaultdict[str, set[str]](set)
    checked_owners = defaultdict[str, set[str]](set)
    for checked in records:
        record = checked.record
        if why_not_genuine(record):
            continue
        genuine_records.append(record)
        submission = record.submission
        name_owners[submission.name].add(submission.digest)
        if checked.level != "scored":
            checked_owners[submission.name].add(submission.digest)
    reasons_by_digest = {}
    for record in genuine_records:
        name = record.submission.name
        if len(name_owners[name]) > 1 and checked_owners[name] != {
            record.submission.digest
        }:
            reasons_by_digest[record.digest] = (
                f"{len(name_owners[name])} submissions have the name {name!r}"
            )
    return reasons_by_digest


def held_back(entrant: Checked, truths: Sequence[Checked]) -> str | None:
    """Return the reason why a record that is better than ``truths`` is not ranked.

    "Better" means significantly better than each of them on one ranked subset. An agent
    that stores the answers for the public scenes could make such a record. ``truths``:
    prediction from ground-truth tracks on the same units, with motion models and with
    the best network. A record on hidden scenes, or that was looked at, is never held
    back.
    """
    looked_at = entrant.signed is not None and entrant.signed.statement.looked_at
    if entrant.on_hidden or looked_at or not truths:
        return None
    for subset in SUBSETS:
        if why_not_on(subset, entrant.sums_on(subset)) is not None:
            continue
        if all(_is_better(entrant, truth, subset) for truth in truths):
            return "better than ground truth: not ranked until looked at"
    return None


def _is_better(entrant: Checked, truth: Checked, subset: Subset) -> bool:
    difference = entrant.minus(truth, subset)
    return difference is not None and difference.mean < 0 and difference.significant


def _not_comparable_reasons(record: Record) -> Iterator[str]:
    """Yield reasons why a record has other conditions than the shipped env."""
    yield from _unlike_baselines(record)
    if reason := why_scored_otherwise(record):
        yield reason
    env = shipped(record.env.id)
    if env is None:
        yield "its environment ships no event weights"
    else:
        yield from _unlike_env(record, env)
    # some weights were frozen later
    if not record.reference.frozen and not _scored_before(record):
        yield "other event weights than the frozen ones"
    if record.seeds != list(SEEDS):
        record_seeds = ", ".join(map(str, record.seeds))
        yield f"seeds {record_seeds}, ranks need {', '.join(map(str, SEEDS))}"
    if record.limits != Limits():
        yield "other limits than those that rank"


def _unlike_baselines(record: Record) -> Iterator[str]:
    if reason := why_not_genuine(record):
        yield reason
    if not may_observe(record):
        yield FOR_BASELINES
    observe = record.env.observe
    baseline = baselines().get(record.submission.name)
    if baseline is not None and baseline.compare.observe != observe:
        yield (
            f"observe is {observe!r}, the baseline of that name has "
            f"{baseline.compare.observe!r}"
        )


def _unlike_env(record: Record, env: Shipped) -> Iterator[str]:
    digest = record.env.card_digest
    if digest != env.card:
        yield earlier_cards().get(
            digest, f"card {digest}, the one that ships is {env.card}"
        )
    changed_settings = [
        f"{name} {value!r}"
        for name, value in record.env.keywords.items()
        if (name, value) != ("samples", env.samples)  # stated, but not another
    ]
    if changed_settings:
        settings_text = clean_text(", ".join(changed_settings), _MAX_SETTINGS)
        yield f"other settings of the env: {settings_text}"
    if record.samples != env.samples:
        yield f"{record.samples} samples per object, not the env's own k"
    if record.reference.hash != env.weights:
        yield "other event weights than the frozen ones"
    if len(record.scenes) != len(env.sums):
        yield f"{len(record.scenes)} of {len(env.sums)} scenes"
    if scene := _scene_of_other_weight(record, env):
        yield f"scene {scene!r} has other targets than its frozen event weights"


def _scene_of_other_weight(record: Record, env: Shipped) -> str | None:
    """Return the first scene with other targets than the event weights.

    None if all fit.
    """
    missing = dict.fromkeys(SUBSETS, math.nan)  # equal to no weight
    keys = [scene_key(record.env.id, scene) for scene in record.scenes]
    scene_weights = [env.sums.get(key, missing) for key in keys]
    fits = np.ones(len(keys), dtype=bool)
    for subset in SUBSETS:
        weights = record.targets.scene_sums(record.unit_weight(subset))
        frozen = np.array([each[subset] for each in scene_weights])
        largest = np.maximum(np.maximum(weights, frozen), 1.0)
        fits &= np.abs(weights - frozen) <= _TOLERANCE * largest
    return None if fits.all() else record.scenes[int(fits.argmin())]


def _why_not_on_hidden(record: Record, hidden: HiddenPart | None) -> str | None:
    """Return why a record of a simulated env has no rank, although it compares."""
    env = shipped(record.env.id)
    if env is None or not env.simulated:
        return None
    if hidden is None:
        return NOT_ON_HIDDEN
    if hidden.scenes < LEAST_HIDDEN:
        return f"scored on {hidden.scenes} hidden scenes, ranks need {LEAST_HIDDEN}"
    return None
