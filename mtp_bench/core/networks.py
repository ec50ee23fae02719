"""Weights of networks: their folders and file names, which of them are missing, and how to train these."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

VARIABLE = "MTP_BENCH_WEIGHTS"
SHIPPED = Path(__file__).parent.parent / "prediction" / "learned" / "weights"
PACKED = ".xz"  # suffix of the files that ship
READS_LANES = "modes_lanes-"  # learns from the env itself: the one whose weights it shares may show no lanes
MINUTES = {  # to train one, measured for MTP-nuScenes-v0 on two cores
    "modes-truth": 1,
    "modes-tracklets": 2,
    "tracking_free-tracklets": 4,
    "affinity-tracklets": 5,
    "ptp-truth": 54,
}


@dataclass(frozen=True)
class NetworkState:
    """A network of a submission on an env: whether its weights exist, and how to train them."""

    network: str  # with its training data, such as modes-truth
    env_id: str  # the env whose training split it learns from
    trained: bool  # on this machine
    ships: bool

    @property
    def missing(self) -> bool:
        """True if there are no weights."""
        return not (self.trained or self.ships)

    @property
    def minutes(self) -> int | None:
        """Minutes that a training takes on two cores; None if it was not measured."""
        return MINUTES.get(self.network)

    @property
    def command(self) -> str:
        """The command that trains it."""
        name, on = self.network.rsplit("-", 1)
        return f"mtp-bench train predictor {name} --env {self.env_id} --on {on}"


def states_of(
    networks: Iterable[str], env_id: str, weights_of: str | None
) -> list[NetworkState]:
    """The states of ``networks``, such as modes-truth, on an env; ``weights_of``: the env whose weights it shares."""
    networks, envs = tuple(networks), [env for env in (env_id, weights_of) if env]
    return [
        NetworkState(
            network,
            env_id if not weights_of or network.startswith(READS_LANES) else weights_of,
            trained=bool(network_files([network], env_id, weights_of)),
            ships=any(
                (SHIPPED / f"{network}-{env}.safetensors{PACKED}").is_file()
                for env in envs
            ),
        )
        for network in networks
    ]


def weights_folder() -> Path:
    """The folder of weights that were trained here: MTP_BENCH_WEIGHTS, else in the user's data folder."""
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser().absolute()
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False) / "weights"


def file_name(network: str, on: str, env_id: str) -> str:
    """Name of the weights of a network that was trained ``on`` "truth" or "tracklets" of an env."""
    return f"{network}-{on}-{env_id}.safetensors"


def network_files(
    networks: Iterable[str], env_id: str, weights_of: str | None
) -> list[Path]:
    """Files of ``networks``, such as modes-truth, trained here for an env or for the one whose weights it shares."""
    envs = (env_id,) if weights_of is None else (env_id, weights_of)
    paths = [
        weights_folder() / f"{network}-{env}.safetensors"
        for network in networks
        for env in envs
    ]
    return [path for path in paths if path.is_file()]
