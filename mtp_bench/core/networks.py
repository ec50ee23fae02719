"""Weights of networks: folders, file names, what is missing, and how to train it."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

WEIGHTS_VARIABLE = "MTP_BENCH_WEIGHTS"
SHIPPED_WEIGHTS = Path(__file__).parent.parent / "prediction" / "learned" / "weights"
PACKED_SUFFIX = ".xz"  # suffix of the files that ship
# trained on each env itself: an env whose weights it could share may show no lanes
_READS_LANES = "modes_lanes-"
# of a training, measured for MTP-nuScenes-v0 on two cores
_MINUTES = {
    "modes-truth": 1,
    "modes-tracklets": 2,
    "tracking_free-tracklets": 4,
    "affinity-tracklets": 5,
    "ptp-truth": 54,
}


@dataclass(frozen=True)
class NetworkState:
    """A network of a submission on an env: whether its weights exist, and how to train them."""

    network: str  # name with its training data, such as modes-truth
    env_id: str  # the env whose training split it learns from
    trained: bool  # on this machine
    ships: bool

    @property
    def missing(self) -> bool:
        """True without any weights."""
        return not (self.trained or self.ships)

    @property
    def minutes(self) -> int | None:
        """Minutes that a training takes on two cores.

        None if it was not measured.
        """
        return _MINUTES.get(self.network)

    @property
    def command(self) -> str:
        """Command that trains it."""
        name, on = self.network.rsplit("-", 1)
        return f"mtp-bench train predictor {name} --env {self.env_id} --on {on}"


def states_of(
    networks: Iterable[str], env_id: str, weights_of: str | None
) -> list[NetworkState]:
    """Return the states of ``networks``, such as modes-truth, on an env.

    ``weights_of``: the env whose weights it shares.
    """
    states = []
    for network in networks:
        trained_on = weights_of or env_id
        if network.startswith(_READS_LANES):
            trained_on = env_id
        ships = any(
            (SHIPPED_WEIGHTS / f"{name}{PACKED_SUFFIX}").is_file()
            for name in _file_names(network, env_id, weights_of)
        )
        trained = bool(network_files([network], env_id, weights_of))
        states.append(NetworkState(network, trained_on, trained, ships))
    return states


def weights_folder() -> Path:
    """Return the folder of weights that were trained here.

    MTP_BENCH_WEIGHTS names it; otherwise it is in the user's data folder.
    """
    if os.environ.get(WEIGHTS_VARIABLE):
        return Path(os.environ[WEIGHTS_VARIABLE]).expanduser().absolute()
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False) / "weights"


def file_name(network: str, on: str, env_id: str) -> str:
    """Return the name of the weights of a network on an env.

    ``on``: "truth" or "tracklets", what it was trained on.
    """
    return f"{network}-{on}-{env_id}.safetensors"


def network_files(
    networks: Iterable[str], env_id: str, weights_of: str | None
) -> list[Path]:
    """List the files of ``networks`` trained here for an env.

    ``weights_of``: another env whose weights it may use; their files are listed, too.
    """
    folder = weights_folder()
    paths: list[Path] = []
    for network in networks:
        paths += [folder / name for name in _file_names(network, env_id, weights_of)]
    return [path for path in paths if path.is_file()]


def _file_names(network: str, env_id: str, weights_of: str | None) -> list[str]:
    """Name the weights of a network for an env, and shared ones."""
    envs = [env_id]
    if weights_of:
        envs.append(weights_of)
    return [f"{network}-{env}.safetensors" for env in envs]
