"""Which records are ranked at all: what ships was run, whole, under the fixed seeds and limits, by whoever it says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict

from ..gateway import Limits
from ..scoring import DEFINITIONS, SUBSETS
from ..scoring.rank import Entrant
from ..scoring.rank import why_unranked as why_entrant_unranked
from ..scoring.weights import scene_key
from .attestation import SignedLevel
from .provenance import scorer_digest
from .record import LimitsPart, Record, ScenePart
from .shipped import Shipped, baseline_digest, shipped

SEEDS = (0, 1, 2)
LEAST_HIDDEN = 50  # hidden scenes that rank
Ships = Callable[[str], Shipped | None]


def why_unranked(record: Record, level: SignedLevel | None = None, ships: Ships = shipped) -> str | None:
    """Why a record is shown, never ranked, in a few words; None where it is ranked.

    ``level``: how far it was checked; ``ships``: what ships for an env, by its id.
    """
    observe = record.env.observe
    entrant = Entrant(record.row.budget, record.samples, observe == "truth", record.unfinished, observe == "tracks")
    return why_entrant_unranked(entrant) or why_not_comparable(record, level, ships)


def why_not_comparable(record: Record, level: SignedLevel | None = None, ships: Ships = shipped) -> str | None:
    """Why the numbers of a record say nothing beside those of others, in a few words; None where they do."""
    if record.earlier_version:
        unsigned = f"version {record.earlier_version}, without a signed level" if level is None else None
        return unsigned or next(_other_runs(record), None) or _not_hidden(record, level, ships)
    other = next(_other_definitions(record, ships), None) or next(_other_runs(record), None)
    return why_not_genuine(record) or other or _not_hidden(record, level, ships)


def why_not_genuine(record: Record) -> str | None:
    """Why a record that names a baseline is not of it; None for the baseline itself and for any other name."""
    if record.earlier_version:
        return None  # another digest than today's, and its level is signed, see `why_not_comparable`
    known = baseline_digest(record.submission.name, record.submission.networks)
    if known is None or known == record.submission.digest:
        return None
    return f"{record.submission.name!r} is the name of a baseline, and this is another submission"


def taken_names(records: Sequence[Record], levels: Mapping[str, SignedLevel]) -> dict[str, str]:
    """Why records of one env are not ranked because another submission has their name: by digest of the record.

    Of several submissions of one name the one whose level is signed keeps it; where none is, or several are, nobody.
    Names of baselines are theirs.
    """
    owners: dict[str, set[str]] = {}
    signed: dict[str, set[str]] = {}
    genuine = [record for record in records if why_not_genuine(record) is None]
    for record in genuine:
        owners.setdefault(record.submission.name, set()).add(record.submission.digest)
        if record.digest in levels:
            signed.setdefault(record.submission.name, set()).add(record.submission.digest)
    found = {}
    for record in genuine:
        name = record.submission.name
        if len(owners[name]) > 1 and signed.get(name) != {record.submission.digest}:
            found[record.digest] = f"{len(owners[name])} submissions have the name {name!r}"
    return found


def _other_definitions(record: Record, ships: Ships) -> Iterator[str]:
    """Differences from the scorer, card and event weights that ship."""
    env, known = record.env, ships(record.env.id)
    if record.scorer.definitions != DEFINITIONS:
        yield f"scored by definitions {record.scorer.definitions}, today's are {DEFINITIONS}"
    if record.scorer.source_digest != scorer_digest():
        yield "another scorer than today's"
    if known is None:
        yield "no env of that id ships"
        return
    if env.card_digest != known.card:
        yield f"card {env.card_digest}, the one that ships is {known.card}"
    if record.reference.hash != known.weights:
        yield "other event weights than the frozen ones"
    if env.scenes != len(known.sums):
        yield f"{env.scenes} of {len(known.sums)} scenes"
    other = next((scene for scene in record.per_scene if not _has_sums_of(known, env.id, scene)), None)
    if other is not None:
        yield f"scene {other.scene!r} has other targets than its frozen event weights"


def _other_runs(record: Record) -> Iterator[str]:
    """Differences from the runs that ranks need, whatever version made them."""
    env = record.env
    if not record.reference.frozen:
        yield "other event weights than the frozen ones"
    if record.missed.late:
        yield "answers came late, which no other run repeats: make it again"
    if record.seeds != list(SEEDS):
        yield f"seeds {', '.join(map(str, record.seeds))}, ranks need {', '.join(map(str, SEEDS))}"
    if env.scenes != env.scenes_of_split:
        yield f"{env.scenes} of {env.scenes_of_split} scenes"
    if record.division == "closed" and record.limits != LimitsPart(**asdict(Limits())):
        yield "other limits than those of the closed division"


def _has_sums_of(known: Shipped, env_id: str, scene: ScenePart) -> bool:
    """Whether the targets of a scene weigh what the frozen weights say."""
    sums = known.sums.get(scene_key(env_id, scene.scene))
    return sums is not None and all(
        math.isclose(sum(scene.weight[subset]), sums[subset], rel_tol=1e-6, abs_tol=1e-6) for subset in SUBSETS
    )


def _not_hidden(record: Record, level: SignedLevel | None, ships: Ships) -> str | None:
    """Why a record of a simulated env is not ranked by hidden scenes."""
    known = ships(record.env.id)
    if known is None or not known.simulated:
        return None
    if level is None or level.hidden is None:
        return "not scored on hidden scenes yet"
    if level.hidden.scenes < LEAST_HIDDEN:
        return f"scored on {level.hidden.scenes} hidden scenes, ranks need {LEAST_HIDDEN}"
    return None
