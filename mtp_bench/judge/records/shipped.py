"""Environments and baselines as they ship: the digests and settings that records are compared with."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from ...agent import Submission, digest_of, files_of, load_submission
from ...cards import load_card
from ...core import DataError, baseline_names, bundled, card_ids, read_toml
from ...running import frozen_reference
from ...scoring import WEIGHED, Reference, Subset
from .evaluation import scorer_digest

FOR_BASELINES = 'observe = "associated" labels detections with true objects, and records of it are of baselines alone'


@dataclass(frozen=True)
class Shipped:
    """Card and frozen event weights of an env."""

    card: str  # digest
    simulated: bool  # hidden scenes rank
    samples: int  # k, per object
    # the largest error of a target, that of a missed one; 1 of a drive
    max_error_m: float
    weights: str  # hash of the frozen event weights
    sums: Mapping[
        str, Mapping[Subset, float]
    ]  # `scene_key` -> weight of the targets of a scene on each subset


@cache
def shipped(env_id: str) -> Shipped | None:
    """The env of this id; None if it does not ship or has no frozen event weights. DataError if these are broken."""
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    frozen = frozen_reference(card)
    if frozen is None:
        return None
    max_error_m = 1.0
    if card.drive is None:
        max_error_m = max(card.per_class(card.task.miss_error))
    return Shipped(
        card.digest,
        card.simulated,
        card.task.samples,
        max_error_m,
        frozen.digest,
        _sums(frozen),
    )


@cache
def earlier_scorers() -> frozenset[tuple[str, str, str]]:
    """Read the earlier scorers whose numbers are those of today: env id, scorer digest, hash of the event weights.

    Raises DataError if the file that lists them cannot be read.
    """
    listed = read_toml(bundled("envs") / "reference" / "earlier.toml", DataError)[
        "earlier"
    ]
    return frozenset(
        (env_id, scorer_digest(each["definitions"], each["golden"]), weights)
        for each in listed
        for env_id, weights in each["weights"].items()
    )


def baseline_digest(name: str, networks: Mapping[str, str] | None = None) -> str | None:
    """Digest of the shipped baseline ``name`` with weights that were trained for it; None for other names."""
    return _digest(name, tuple(sorted((networks or {}).items())))


@cache
def baselines() -> Mapping[str, Submission]:
    """The shipped baselines by name, sorted."""
    return {name: load_submission(name) for name in baseline_names()}


@cache  # a leaderboard asks again for every subset
def _digest(name: str, networks: tuple[tuple[str, str], ...]) -> str | None:
    if name not in baselines():
        return None
    folder = baselines()[name].path
    return digest_of(folder, files_of(folder), dict(networks))


@cache
def network_references(network: str, observe: str) -> tuple[str, str] | None:
    """The pair of a gap of predictors with a trained network, such as modes-truth; None if no pair ships.

    Of the baselines with this network, the one with the parameters of its own references, a single hypothesis, and the
    one that observes the truth, or "associated" for the association gap.
    """
    users = [user for user in baselines().values() if network in user.networks]
    single = [user.name for user in users if _is_single(user, observe)]
    other = [user.name for user in users if user.compare.observe == observe]
    return (single[0], other[0]) if single and other else None


def learned_truths() -> tuple[str, ...]:
    """Names of the baselines that predict with a network from ground-truth tracks."""
    return tuple(
        name
        for name, each in baselines().items()
        if each.networks and each.compare.observe == "truth"
    )


def _is_single(user: Submission, observe: str) -> bool:
    """True if a submission observes detections, with the parameters of its own references."""
    own = user.compare.association_references if observe == "associated" else None
    references = user.compare.gap_references if own is None else own
    if user.compare.observe != "detections" or not isinstance(references, dict):
        return False
    return all(user.parameters.get(name) == value for name, value in references.items())


def _sums(reference: Reference) -> dict[str, dict[Subset, float]]:
    """Sums of `Reference.weight` per scene; scenes are known by their keys alone."""
    sums: dict[str, dict[Subset, float]] = {}
    for key, scene in reference.scenes.items():
        sums[key] = {"all": float(scene.targets)}
        for subset in WEIGHED:
            sums[key][subset] = float(reference.weight_in(scene, subset).sum())
    return sums
