"""The Gymnasium environment: `MTPEnv`, its spaces, and the table of the action's fields.

The class is imported when it is first used: agents need `mtp_bench.env.action` only.
"""

import typing as _typing

if _typing.TYPE_CHECKING:
    from .environment import MTPEnv as MTPEnv
else:

    def __getattr__(name: str) -> _typing.Any:
        if name == "MTPEnv":
            from .environment import MTPEnv

            return MTPEnv
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
