"""Traffic of a Gymnasium environment: everything that its scenes depend on."""

import hashlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import CardError
from ..highway.world import World


@dataclass(frozen=True)
class GymTraffic:
    """Everything that a simulation depends on."""

    id: str
    module: str  # that registers the id; empty: highway-env, or the running program
    code: str  # sha256 of the module's file
    config: dict[str, Any]
    policy: str
    seconds: float

    @property
    def scenario(self) -> str:
        """The id without its module and namespace: begins the names of folders and scenes."""
        return self.id.rpartition(":")[2].rpartition("/")[2]

    def simulate(self, seed: int) -> World:
        """The world of a seed, see `simulate.simulate`."""
        from .simulate import simulate  # imports highway-env

        return simulate(self, seed)


def traffic_of(env_id: str, module: str | None, config: dict[str, Any], policy: str, seconds: float) -> GymTraffic:
    """The traffic of a card's section; raises CardError for a module that there is not."""
    name = module or (env_id.partition(":")[0] if ":" in env_id else "")
    found = name and importlib.util.find_spec(name.partition(".")[0]) and importlib.util.find_spec(name)
    if name and not found:
        raise CardError(f"source.module: no module {name!r}; install it, or name its folder in PYTHONPATH")
    path = Path(found.origin) if found and found.origin else None
    code = hashlib.sha256(path.read_bytes()).hexdigest() if path and path.is_file() else ""
    return GymTraffic(env_id, name, code, config, policy, seconds)
