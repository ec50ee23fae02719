"""Networks by name."""

from __future__ import annotations

from ...errors import UnknownNameError
from .affinity import AffinityNetwork
from .modes import Modes
from .network import Network
from .ptp import Ptp
from .tracking_free import TrackingFree

_ALL: tuple[Network, ...] = (Modes(), Ptp(), TrackingFree(), AffinityNetwork())
NETWORKS: dict[str, Network] = {network.name: network for network in _ALL}
AROUND = ("affinity", "tracking_free")  # their input is the detections around an object, not its track


def network_of(name: str) -> Network:
    """The network of this name; raises UnknownNameError."""
    if name not in NETWORKS:
        raise UnknownNameError("network", name, NETWORKS)
    return NETWORKS[name]
