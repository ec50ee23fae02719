"""The doctor: what recordings say about themselves, and what to doubt."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
