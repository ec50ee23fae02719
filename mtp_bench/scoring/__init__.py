"""Definitions of the protocol as functions of arrays: every number and rule of rank."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
