"""Weights of networks trained on this machine: their folder and file names."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

VARIABLE = "MTP_BENCH_WEIGHTS"


def weights_folder() -> Path:
    """The folder of weights that were trained here: MTP_BENCH_WEIGHTS, else in the user's data folder."""
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser().absolute()
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False) / "weights"


def file_name(network: str, on: str, env_id: str) -> str:
    """Name of the weights of a network that was trained ``on`` "truth" or "tracklets" of an env."""
    return f"{network}-{on}-{env_id}.safetensors"


def network_files(networks: Iterable[str], env_id: str, weights_of: str | None) -> list[Path]:
    """Files of ``networks``, such as modes-truth, trained here for an env or for the one whose weights it shares."""
    envs = (env_id,) if weights_of is None else (env_id, weights_of)
    paths = [weights_folder() / f"{network}-{env}.safetensors" for network in networks for env in envs]
    return [path for path in paths if path.is_file()]
