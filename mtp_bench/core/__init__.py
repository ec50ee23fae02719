"""Types, errors, files, geometry, tables and parallel work: what every room needs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
