"""Tracking and prediction together: your agent sees detections, not the truth.

``import mtp_bench`` registers every card of ``envs/`` with Gymnasium::

    import gymnasium as gym, mtp_bench
    env = gym.make("MTP-KITTI-v0", data="/path/to/data")

Each name of ``__init__.pyi`` is imported when it is first used.
"""

import gymnasium as _gymnasium
import lazy_loader as _lazy

from .core import card_ids as _card_ids

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

for _env_id in _card_ids():
    if _env_id not in _gymnasium.registry:  # the module may be loaded anew
        _gymnasium.register(
            id=_env_id, entry_point="mtp_bench:MTPEnv", kwargs={"card": _env_id}
        )
