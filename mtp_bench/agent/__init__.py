"""Agents: their interface, actions, the usual pipeline, and folders that hold a submission."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
