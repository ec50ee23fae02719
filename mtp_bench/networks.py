"""Weights of networks that were trained on this machine: where they are kept, and by what names they are found."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

VARIABLE = "MTP_BENCH_WEIGHTS"
LENDERS = {  # envs that take the weights of another one, where objects move alike at the same rate
    "MTP-Merge-v0": "MTP-Highway-v0",
    "MTP-IntersectionRaw-v0": "MTP-Intersection-v0",
    "MTP-Roundabout-v0": "MTP-Intersection-v0",
    "MTP-nuScenes-CenterPoint-v0": "MTP-nuScenes-v0",  # of its detector there are no training detections
}


def weights_folder() -> Path:
    """Where weights that were trained here are kept: what MTP_BENCH_WEIGHTS names, else the user's data folder."""
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser().absolute()
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False) / "weights"


def file_name(network: str, on: str, env_id: str) -> str:
    """Name of the weights of a network that was trained ``on`` "truth" or "tracklets" of an env."""
    return f"{network}-{on}-{env_id}.safetensors"


def lender_of(env_id: str) -> str:
    """The env whose weights an env takes where it has none of its own; itself where it borrows from nobody."""
    return LENDERS.get(env_id, env_id)


def network_files(networks: Iterable[str], env_id: str) -> list[Path]:
    """Files of ``networks``, such as modes-truth, that were trained here for an env or the one it borrows from."""
    envs = dict.fromkeys((env_id, lender_of(env_id)))
    names = [f"{network}-{env}.safetensors" for network in networks for env in envs]
    return [path for path in (weights_folder() / name for name in names) if path.is_file()]
