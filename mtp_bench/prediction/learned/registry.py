"""The networks by name."""

from __future__ import annotations

from ...errors import UnknownNameError
from .affinity import Affinity
from .codebook import Codebook
from .modes import Modes
from .network import Network
from .tracking_free import TrackingFree

NETWORKS: dict[str, Network] = {network.name: network for network in (Modes(), TrackingFree(), Affinity(), Codebook())}


def network_of(name: str) -> Network:
    """The network of this name; raises UnknownNameError."""
    if name not in NETWORKS:
        raise UnknownNameError("network", name, NETWORKS)
    return NETWORKS[name]
