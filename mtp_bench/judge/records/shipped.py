"""Environments and baselines as they ship, which records are compared with."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from ...agent import Submission, digest_of, files_of, load_submission
from ...cards import load_card
from ...core import DataError, baseline_names, bundled, card_ids, read_toml
from ...running import frozen_reference
from ...scoring import WEIGHTED_SUBSETS, Reference, Subset
from .evaluation import scorer_digest

FOR_BASELINES = (
    'observe = "associated" labels detections with true objects, and records of it are '
    "of baselines alone"
)


@dataclass(frozen=True)
class Shipped:
    """Card and frozen event weights of an env."""

    card: str  # digest
    simulated: bool  # hidden scenes rank
    samples: int  # k, per object
    # the largest error of a target, that of a missed one; 1 of a drive
    max_error_m: float
    weights: str  # hash of the frozen event weights
    # `scene_key` -> weight of the targets of a scene on each subset
    sums: Mapping[str, Mapping[Subset, float]]


@cache
def shipped(env_id: str) -> Shipped | None:
    """Return the env of this id.

    None without a card or frozen event weights. Raises DataError if the event weights
    are broken.
    """
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    reference = frozen_reference(card)
    if reference is None:
        return None
    max_error_m = 1.0
    if card.drive is None:
        max_error_m = max(card.per_class(card.task.miss_error))
    return Shipped(
        card=card.digest,
        simulated=card.simulated,
        samples=card.task.samples,
        max_error_m=max_error_m,
        weights=reference.digest,
        sums=_sums(reference),
    )


@cache
def earlier_scorers() -> frozenset[tuple[str, str, str]]:
    """Read the earlier scorers whose numbers are those of today.

    Each is an env id, a scorer digest and the hash of the event weights. Raises
    DataError if the file that lists them cannot be read.
    """
    path = bundled("envs") / "reference" / "earlier.toml"
    scorers = set()
    for scorer in read_toml(path, DataError)["earlier"]:
        sha256 = scorer_digest(scorer["definitions"], scorer["golden"])
        for env_id, weights in scorer["weights"].items():
            scorers.add((env_id, sha256, weights))
    return frozenset(scorers)


@cache
def earlier_cards() -> Mapping[str, str]:
    """Read why records of earlier cards are shown apart, by the digests of the cards.

    Raises DataError if the file that lists them cannot be read.
    """
    path = bundled("envs") / "reference" / "earlier.toml"
    return dict(read_toml(path, DataError)["cards"])


def baseline_digest(name: str, networks: Mapping[str, str] | None = None) -> str | None:
    """Return the digest of the shipped baseline ``name``.

    None for other names. ``networks``: weights that were trained for it.
    """
    return _digest(name, tuple(sorted((networks or {}).items())))


@cache
def baselines() -> Mapping[str, Submission]:
    """Return the shipped baselines by name, sorted."""
    return {name: load_submission(name) for name in baseline_names()}


@cache  # a leaderboard asks again for every subset
def _digest(name: str, networks: tuple[tuple[str, str], ...]) -> str | None:
    if name not in baselines():
        return None
    folder = baselines()[name].path
    return digest_of(folder, files_of(folder), dict(networks))


@cache
def network_references(network: str, observe: str) -> tuple[str, str] | None:
    """Return the two baselines between which a predictor with a network closes a gap.

    ``network``: such as modes-truth. The first one tracks detections with a single
    hypothesis. The second one observes what ``observe`` says: "truth" for gap_closed,
    "associated" for the association gap. None if no pair ships.
    """
    network_users = [user for user in baselines().values() if network in user.networks]
    single_names = [user.name for user in network_users if _is_single(user, observe)]
    for user in network_users:
        if single_names and user.compare.observe == observe:
            return single_names[0], user.name
    return None


def networks_on_truth() -> tuple[str, ...]:
    """Return the baselines that predict with a network from ground-truth tracks."""
    truth_names = []
    for name, baseline in baselines().items():
        if baseline.networks and baseline.compare.observe == "truth":
            truth_names.append(name)
    return tuple(truth_names)


def _is_single(user: Submission, observe: str) -> bool:
    """Return True for a submission that is the lower reference of its own gap.

    It observes detections, and has the parameters that its manifest states for
    references, such as a single hypothesis.
    """
    references = user.compare.gap_references
    if observe == "associated" and user.compare.association_references is not None:
        references = user.compare.association_references
    if user.compare.observe != "detections" or not isinstance(references, dict):
        return False
    return all(user.parameters.get(name) == value for name, value in references.items())


def _sums(reference: Reference) -> dict[str, dict[Subset, float]]:
    """Return sums of `Reference.weight` per scene, by the keys of scenes."""
    sums: dict[str, dict[Subset, float]] = {}
    for key, scene in reference.scenes.items():
        sums[key] = {"all": float(scene.targets)}
        for subset in WEIGHTED_SUBSETS:
            sums[key][subset] = float(reference.weight_in(scene, subset).sum())
    return sums
