"""The networks by name."""

from __future__ import annotations

from ...errors import UnknownNameError
from .modes import Modes
from .network import Network
from .ptp import Ptp
from .social_lstm import SocialLstm

NETWORKS: dict[str, Network] = {network.name: network for network in (Modes(), Ptp(), SocialLstm())}


def network_of(name: str) -> Network:
    """The network of this name; raises UnknownNameError."""
    if name not in NETWORKS:
        raise UnknownNameError("network", name, NETWORKS)
    return NETWORKS[name]
