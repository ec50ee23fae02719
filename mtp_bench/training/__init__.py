"""Training: windows of tracklets with their true futures, and models fitted to them."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
