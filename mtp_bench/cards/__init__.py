"""Cards: the source, task and sizes of an environment, as strict TOML."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
